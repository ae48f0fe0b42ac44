"""What counts as the same object again."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.types import Observation3D
from tracking.again import AgainParams, is_same
from tracking.color import N_BINS, ColorModel

SEEN = Observation3D(0.0, np.zeros(3), np.eye(3), 0.03, 1e-6, 0.1)


def model(share: float) -> ColorModel:
    """A share of one colour, the rest of another."""
    colors = np.zeros(N_BINS)
    colors[[3, 40]] = share, 1 - share
    return ColorModel(colors, np.full(N_BINS, 1 / N_BINS))


@pytest.mark.parametrize(
    ("left", "right", "radius_m", "same"),
    [
        (0.9, 0.9, 0.03, True),
        (0.8, 0.95, 0.025, True),
        (0.9, 0.1, 0.03, False),  # another colour in one eye
        (0.1, 0.9, 0.03, False),
        (0.9, 0.9, 0.02, False),  # another size
        (0.9, 0.9, 0.04, False),
    ],
)
def test_colours_in_either_eye_and_size_must_agree(left: float, right: float, radius_m: float, same: bool) -> None:
    known, found = (model(0.9), model(0.9)), (model(left), model(right))
    assert is_same(AgainParams(), known, 0.03, found, replace(SEEN, radius_m=radius_m)) == same


def test_what_no_pair_gives_is_not_the_same_and_a_marker_has_no_colours_to_compare() -> None:
    assert not is_same(AgainParams(), (None, None), 0.03, (None, None), None)
    assert is_same(AgainParams(), (None, model(0.9)), 0.03, (model(0.1), None), SEEN)
