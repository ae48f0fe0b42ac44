"""Lenses that cannot be, and what they are told to show."""

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera
from pps_vision.robot.icub import LEFT_EYE
from rendering.lens import Lens


def test_a_lens_that_folds_the_image_back_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a lens that can be undone over the whole image"):
        Lens(Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-1.0, 0.0, 0.0, 0.0, 0.0)))


def test_the_slopes_hold_all_that_projects_into_the_image() -> None:
    left, top, right, bottom = Lens(LEFT_EYE).slopes
    points = np.random.default_rng(0).uniform((-1.5, -1.5, 1), (1.5, 1.5, 1), (4000, 3))
    u, v = LEFT_EYE.project(points).T
    inside = (u > -0.5) & (u < 319.5) & (v > -0.5) & (v < 239.5)
    x, y = points[inside, :2].T
    assert left < x.min() < left + 0.03
    assert right - 0.03 < x.max() < right
    assert top < y.min() < top + 0.03
    assert bottom - 0.03 < y.max() < bottom
