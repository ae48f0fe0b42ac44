"""What the compiled functions do by themselves, against OpenCV."""

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.compiled import _undistorted


def test_the_first_guess_of_a_normalised_point_is_opencvs(rng: np.random.Generator) -> None:
    """Both iterate five times."""
    camera = Camera(320, 240, 220.0, 230.0, 161.0, 118.0, (-0.3, 0.12, 0.003, -0.002, 0.05))
    view = View(camera, np.eye(4))
    for u, v in rng.uniform((0, 0), (319, 239), (20, 2)).tolist():
        found = _undistorted((view.pose, camera.numbers, u, v, 1.0, 0.0, 1.0))
        theirs = cv2.undistortPoints(np.array([[[u, v]]]), camera.K, camera.lens)
        np.testing.assert_allclose(found, theirs[0, 0], atol=1e-10)
