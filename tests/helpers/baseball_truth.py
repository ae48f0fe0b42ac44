"""The real ball of `../shared/data/baseball`, where its pixels were read off the pictures by eye."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from pps_vision.experiments.films.recordings import Footage
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.types import Array, StereoFrame

FIRST = 5
"""Number of the first picture."""
SEEN = {
    8: (370, 91, 279.5, 86.5),
    14: (383, 71, 275.8, 65.8),
    20: (402, 55, 270.8, 51),
    26: (433, 51, 262.7, 48.6),
    30: (462, 65, 254, 60),
    34: (511, 98, 240, 93),
    38: (597, 180, 216, 175),
    39: (619, 207, 207, 207),
}
"""Where the ball is: number of the picture: left u, v, right u, v (px)."""
_UNIT_M = 0.0254  # the calibration's squares are taken for an inch
_FPS = 30.0
_RADIUS_M = 0.037


def ball_px(numbers: ArrayLike) -> Array:
    """(n, 4) left u, v and right u, v in the pictures of these numbers: a spline through the pixels read by eye."""
    return np.asarray(CubicSpline(list(SEEN), np.array(list(SEEN.values())))(numbers))


def baseball(folder: Path) -> Footage:
    """The recording; as truth the pixels that were read, triangulated by OpenCV with the calibration that is there.

    The calibration does not fit the pictures, so this truth shares its error with every tracker: it tells how much one
    errs more than another, not how far either is from the ball.
    """
    files = [folder / f"calibration_{name}_final.xml" for name in ("left", "right", "stereo")]
    left, right, T_left_right = read_stereo_calibration(files, (640, 480), _UNIT_M)
    rig = StereoRig.fixed(left, right, T_left_right)
    opened = open_stereo_images([str(folder / "1L*.jpg")], [str(folder / "1R*.jpg")], fps=_FPS)
    frames = tuple(frame for frame in opened if isinstance(frame, StereoFrame))
    numbers = np.arange(FIRST, FIRST + len(frames))
    u = ball_px(numbers)
    rays = [
        cv2.undistortPoints(u[:, None, k : k + 2], camera.K, camera.lens)[:, 0].T
        for k, camera in ((0, left), (2, right))
    ]
    projections = [np.eye(4)[:3], np.linalg.inv(T_left_right)[:3]]
    homogeneous = cv2.triangulatePoints(*projections, *rays)
    position = (homogeneous[:3] / homogeneous[3]).T
    visible = (numbers >= min(SEEN)) & (numbers <= max(SEEN))
    velocity = np.gradient(position, 1 / _FPS, axis=0)
    return Footage(frames, position, velocity, visible, ((None, None),) * len(frames), _RADIUS_M, rig, own_body=None)
