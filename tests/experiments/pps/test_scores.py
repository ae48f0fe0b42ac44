"""Scores of probabilities against SciPy and worked-out cases."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, ttest_rel

from pps_vision.experiments.pps_prediction import auroc, brier, brier_gain, expected_calibration_error


@pytest.mark.parametrize("levels", [3, 1000])
def test_auroc_is_the_mann_whitney_statistic(levels):
    rng = np.random.default_rng(0)
    outcome = rng.random(200) < 0.3
    score = rng.integers(0, levels, 200) + 0.3 * levels * outcome
    u = mannwhitneyu(score[outcome], score[~outcome]).statistic
    assert auroc(outcome, score) == pytest.approx(u / (outcome.sum() * (~outcome).sum()))
    assert np.isnan(auroc([1, 1], [0.5, 0.2]))


def test_the_gain_on_a_reference_is_that_of_paired_units():
    """As by a paired t test, which agrees with resampling for many units."""
    rng = np.random.default_rng(4)
    outcome = rng.random((400, 4)) < 0.4
    probability = rng.random((400, 4))
    reference = 0.8 * probability + 0.1
    scores = [[brier(y, p) for y, p in zip(outcome, values, strict=True)] for values in (reference, probability)]
    interval = ttest_rel(*scores).confidence_interval(0.95)
    gain = brier(outcome, reference) - brier(outcome, probability)
    width = interval.high - interval.low
    expected = pytest.approx((gain, interval.low, interval.high), abs=0.1 * width)
    assert brier_gain(outcome, probability, reference) == expected


def test_the_calibration_error_of_a_worked_out_case():
    """Ten bins: 0.096 is in the first, 0.85 not in the last, and 1 is."""
    p = [0.0, 0.096, 0.62, 0.85, 0.92, 1.0]
    error = expected_calibration_error([0, 1, 1, 0, 1, 1], p)
    assert error == pytest.approx((2 * 0.452 + 0.38 + 0.85 + 2 * 0.04) / 6)
