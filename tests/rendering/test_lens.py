"""The lens that bends what was drawn, against OpenCV's projection; and lenses that cannot be."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera
from pps_vision.robot.icub import LEFT_EYE
from rendering.lens import make_lens


def test_a_point_drawn_appears_where_opencv_projects_it() -> None:
    lens = make_lens(LEFT_EYE)
    rows, columns = np.mgrid[: lens.pinhole.height, : lens.pinhole.width]
    for point in ([0.05, 0.02, 0.4], [-0.2, 0.12, 0.4], [0.22, -0.15, 0.4]):
        u, v = (
            lens.pinhole.fx * point[0] / point[2] + lens.pinhole.cx,
            lens.pinhole.fy * point[1] / point[2] + lens.pinhole.cy,
        )
        recorded = lens.warp(np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 8).astype(np.float32))
        assert recorded.shape == (240, 320)
        at = np.array([(recorded * grid).sum() for grid in np.mgrid[:240, :320][::-1]]) / recorded.sum()
        theirs = cv2.projectPoints(np.array(point), np.zeros(3), np.zeros(3), LEFT_EYE.K, np.array(LEFT_EYE.distortion))
        np.testing.assert_allclose(at, theirs[0].ravel(), atol=0.1)


def test_a_lens_that_folds_the_image_back_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a lens that can be undone over the whole image"):
        make_lens(Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-1.0, 0.0, 0.0, 0.0, 0.0)))
