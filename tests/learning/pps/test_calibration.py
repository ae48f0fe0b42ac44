"""Calibration against distortions that are known."""

from collections.abc import Callable

import numpy as np
import pytest
from data import SEED

from learning.pps.calibration import calibrate
from learning.pps.scores import expected_calibration_error
from pps_vision.types import Array


@pytest.mark.parametrize("distort", [lambda p: p**2, lambda p: 0.5 + 0.4 * p, lambda p: p], ids=["low", "high", "none"])
def test_a_distortion_is_undone(distort: Callable[[Array], Array]) -> None:
    rng = np.random.default_rng(SEED)
    p = rng.uniform(size=20_000)
    happens = rng.uniform(size=p.size) < p
    corrected = calibrate(happens[::2], distort(p[::2]))(distort(p[1::2]))
    assert np.abs(corrected - p[1::2]).mean() < 0.03
    assert expected_calibration_error(happens[1::2], corrected) < 0.03


def test_the_corrected_rise_with_the_predicted_and_stay_flat_beyond_them() -> None:
    corrected = calibrate([False, True, False, True], [0.1, 0.2, 0.6, 0.9])(np.array([0.0, 0.1, 0.2, 0.6, 0.9, 1.0]))
    np.testing.assert_allclose(corrected, [0, 0, 0.5, 0.5, 1, 1])  # by hand: the two in the middle are pooled


@pytest.mark.parametrize(("outcome", "said"), [([], []), ([1], [0.1, 0.2]), ([1], [np.nan])])
def test_what_cannot_be_calibrated_is_refused(outcome: list[float], said: list[float]) -> None:
    with pytest.raises(ValueError, match="expected as many of each"):
        calibrate(outcome, said)
