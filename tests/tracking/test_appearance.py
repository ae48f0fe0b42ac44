"""Whether two objects are one by colours and size, and where colours segment none."""

import numpy as np
import pytest

from pps_vision.geometry.masks import Box
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Mask
from tracking.acquisition import segment
from tracking.appearance import N_BINS, ColorModel, is_same_object
from tracking.motion_trigger import Region2D
from tracking.outline import Optics


def model(share: float) -> ColorModel:
    """A share of one colour, the rest of another."""
    colors = np.zeros(N_BINS)
    colors[[3, 40]] = share, 1 - share
    return ColorModel(colors, np.full(N_BINS, 1 / N_BINS))


@pytest.mark.parametrize(
    ("left", "right", "radius_m", "is_same"),
    [
        (0.9, 0.9, 0.03, True),
        (0.8, 0.95, 0.025, True),
        (0.9, 0.1, 0.03, False),  # another colour in one eye
        (0.1, 0.9, 0.03, False),
        (0.9, 0.9, 0.02, False),  # another size
        (0.9, 0.9, 0.04, False),
    ],
)
def test_colours_in_either_eye_and_size_must_agree(left, right, radius_m, is_same):
    tracked = (model(0.9), model(0.9))
    detected = (model(left), model(right))
    assert is_same_object(tracked, 0.03, detected, radius_m) == is_same


class Unchanged:
    """A foreground that shows nothing, and leaves it to distinct colours."""

    def confirms(self, colored: Mask, box: Box) -> bool:
        return True

    def moved_mask(self, seed: Mask, box: Box) -> None: ...


def test_where_an_object_has_the_colours_of_what_is_around_none_is_taken_up(rng):
    """Blue among specks: none, an eighth, a quarter, or two thirds as many as in the disc."""
    v, u = np.mgrid[:240, :320]
    disc = np.hypot(u - 150, v - 110) < 15
    region = Region2D((138, 98, 25, 25), np.ones((25, 25), bool), 1.0)
    for around, is_taken in ((0.0, True), (0.12, True), (0.25, True), (0.6, False)):
        blue = rng.random(disc.shape) < np.where(disc, 0.9, around)
        image = np.where(blue[..., None], (30, 60, 210), (200, 40, 40)).astype(np.uint8)
        for foreground in (None, Unchanged()):
            assert (segment(image, region, Optics(LEFT_EYE), foreground) is not None) == is_taken
