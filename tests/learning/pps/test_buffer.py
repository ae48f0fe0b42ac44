"""The event buffer: its length and its 50 ms grid."""

import numpy as np
import pytest

from learning.pps.buffer import EventBuffer, push, resample
from pps_vision.types import TaxelEvents


def sample(stamp_s, distance_m, ttc_s):
    return TaxelEvents(stamp_s, ("a", "b"), np.array(distance_m), np.array(ttc_s), np.array([False, False]))


def filled(stamps, distance=lambda t: 0.2 - 0.05 * t, ttc=lambda t: 4 - t):
    buffer = EventBuffer()
    for t in stamps:
        buffer = push(buffer, sample(t, [distance(t), np.nan], [ttc(t), np.nan]))
    return buffer


def series(buffer: EventBuffer) -> tuple[np.ndarray, np.ndarray]:
    """D and TTC (T, 2) of both taxels, NaN of one without a sample."""
    taxels, *perceived = resample(buffer, np.arange(2))
    D, TTC = np.full((2, len(perceived[0]), 2), np.nan)
    D[:, taxels], TTC[:, taxels] = perceived
    return D, TTC


def test_keeps_three_seconds():
    buffer = filled(np.arange(0, 10, 0.1))
    assert buffer[0].stamp_s == pytest.approx(6.9)
    assert buffer[-1].stamp_s == pytest.approx(9.9)


@pytest.mark.parametrize("step_s", [0.05, 1 / 30, 0.04, 0.1])
def test_grid_of_50_ms_back_from_the_last_sample(step_s):
    stamps = np.arange(0, 2.01, step_s)
    D, TTC = series(filled(stamps))
    times = stamps[-1] - 0.05 * np.arange(int(stamps[-1] / 0.05 + 1e-6), -1, -1)
    np.testing.assert_allclose(D[:, 0], 0.2 - 0.05 * times, atol=1e-9)  # linear in time: interpolation is exact
    np.testing.assert_allclose(TTC[:, 0], 4 - times, atol=1e-9)
    assert np.isnan(D[:, 1]).all()


def test_between_two_samples_a_series_is_a_straight_line():
    """Up and down, at any steps: NumPy's own interpolation.  One sample is one row."""
    stamps = np.cumsum([0.0, 0.03, 0.08, 0.11, 0.02, 0.14, 0.05, 0.07])
    heights = np.random.default_rng(2).uniform(0.0, 0.2, len(stamps))
    D, _ = series(filled(stamps, lambda t: np.interp(t, stamps, heights)))
    assert len(D) == 11
    np.testing.assert_allclose(D[:, 0], np.interp(0.5 - 0.05 * np.arange(10, -1, -1), stamps, heights), atol=1e-12)
    D, TTC = series(filled([1.0]))
    assert D.shape == TTC.shape == (1, 2)
    assert D[0, 0] == pytest.approx(0.15)


@pytest.mark.parametrize(("gap_s", "is_bridged"), [(0.14, True), (0.2, False)])
def test_a_gap_of_less_than_three_steps_is_bridged_and_one_of_four_is_not(gap_s, is_bridged):
    D, _ = series(filled([0.0, 0.05, 0.05 + gap_s, 0.1 + gap_s]))
    assert np.isfinite(D[2:-2, 0]).all() == is_bridged


def test_absent_and_infinite_samples_do_not_spread():
    buffer = filled([0.0, 0.05])
    buffer = push(buffer, sample(0.10, [0.1, 0.1], [np.inf, 1.0]))
    buffer = push(buffer, sample(0.15, [0.1, 0.1], [1.0, 1.0]))
    D, TTC = series(buffer)
    np.testing.assert_array_equal(np.isfinite(D), [[1, 0], [1, 0], [0, 1], [1, 1]])
    np.testing.assert_array_equal(np.isfinite(TTC), np.isfinite(D))


def test_refuses_a_stamp_that_does_not_advance_and_other_taxels():
    buffer = filled([1.0])
    events = TaxelEvents(2.0, ("a",), np.zeros(1), np.zeros(1), np.zeros(1, bool))
    for wrong, message in ((sample(1.0, [0.1, 0.1], [1.0, 1.0]), "stamp 1.0 s after 1.0 s"), (events, "own taxels")):
        with pytest.raises(ValueError, match=message):
            push(buffer, wrong)
    with pytest.raises(ValueError, match="a buffer without samples"):
        resample(EventBuffer(), np.arange(2))
