"""Impossible lenses are refused; possible ones against OpenCV."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE
from rendering.lens import Lens, pinholes


def test_a_lens_that_folds_the_image_back_is_refused():
    with pytest.raises(ValueError, match="expected a lens that can be undone over the whole image"):
        Lens(Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-1.0, 0.0, 0.0, 0.0, 0.0)))


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_pinhole_image_holds_every_pixel_where_opencv_projects_from(scale):
    """Points of the pinhole image, projected by OpenCV, land on the pixels that the map takes from there."""
    lenses = [Lens(LEFT_EYE), Lens(RIGHT_EYE)]
    for lens, pinhole in zip(lenses, pinholes(lenses, scale), strict=True):
        whole, fraction = lens.map_to(pinhole)
        uv = whole + np.stack([fraction % 32, fraction // 32], axis=-1) / 32.0  # OpenCV's fixed point
        assert uv.min() >= 0
        assert uv.min(axis=(0, 1)).max() < scale + 1, "a margin of one of the lens's pixels, rounded up"
        assert uv[..., 0].max() <= pinhole.width - 1
        assert uv[..., 1].max() <= pinhole.height - 1
        xy = (uv - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        points = np.concatenate([xy.reshape(-1, 2), np.ones((uv[..., 0].size, 1))], axis=1)
        c = lens.camera
        px = cv2.projectPoints(points, np.zeros(3), np.zeros(3), c.K, np.array(c.distortion))[0].reshape(240, 320, 2)
        v, u = np.mgrid[:240, :320]
        assert np.abs(px - np.stack([u, v], axis=-1)).max() < 0.03
    assert len({(p.width, p.height) for p in pinholes(lenses, scale)}) == 1
