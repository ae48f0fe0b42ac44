"""Scores against SciPy and worked-out cases."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, ttest_rel

from pps_vision.experiments.pps.scores import auroc, brier, brier_gain, expected_calibration_error, reliability


@pytest.mark.parametrize("levels", [3, 1000])
def test_auroc_is_the_mann_whitney_statistic(levels):
    rng = np.random.default_rng(0)
    outcome = rng.random(200) < 0.3
    score = rng.integers(0, levels, 200) + 0.3 * levels * outcome
    u = mannwhitneyu(score[outcome], score[~outcome]).statistic
    assert auroc(outcome, score) == pytest.approx(u / (outcome.sum() * (~outcome).sum()))


def test_auroc_of_extremes():
    assert auroc([0, 0, 1], [0.1, 0.2, 0.3]) == 1
    assert auroc([1, 0, 0], [0.1, 0.2, 0.3]) == 0
    assert auroc([1, 0], [0.5, 0.5]) == 0.5
    assert np.isnan(auroc([1, 1], [0.5, 0.2]))


def test_brier_score():
    assert brier([1, 0], [1.0, 0.0]) == 0
    assert brier([[1], [0]], [[0.5], [0.2]]) == pytest.approx((0.25 + 0.04) / 2)


def test_the_gain_over_a_reference_and_its_interval_are_those_of_a_paired_t_test():
    rng = np.random.default_rng(4)
    outcome, probability, reference = rng.random((9, 4)) < 0.4, rng.random((9, 4)), rng.random((9, 4))
    scores = [[brier(y, p) for y, p in zip(outcome, of, strict=True)] for of in (reference, probability)]
    interval = ttest_rel(*scores).confidence_interval(0.95)
    gain = brier(outcome, reference) - brier(outcome, probability)
    assert brier_gain(outcome, probability, reference) == pytest.approx((gain, interval.low, interval.high))


def test_reliability_of_a_worked_out_case():
    """Ten bins: 0.096 is in the first, 0.85 not in the last, and 1 is."""
    outcome, p = [0, 1, 1, 0, 1, 1], [0.0, 0.096, 0.62, 0.85, 0.92, 1.0]
    r = reliability(outcome, p)
    np.testing.assert_allclose(r.predicted, [0.048, 0.62, 0.85, 0.96])
    np.testing.assert_allclose(r.happened, [0.5, 1.0, 0.0, 1.0])
    assert r.n.tolist() == [2, 1, 1, 2]
    assert expected_calibration_error(outcome, p) == pytest.approx((2 * 0.452 + 0.38 + 0.85 + 2 * 0.04) / 6)


def test_reliability_is_a_part_of_the_brier_score():
    """Murphy (1973): Brier = reliability - resolution + uncertainty, where a bin holds one probability."""
    rng = np.random.default_rng(1)
    p = rng.choice([0.05, 0.35, 0.65, 0.95], 500)
    y = rng.random(500) < p**1.5
    r = reliability(y, p)
    share, base = r.n / r.n.sum(), y.mean()
    parts = share @ (r.predicted - r.happened) ** 2 - share @ (r.happened - base) ** 2 + base * (1 - base)
    assert brier(y, p) == pytest.approx(parts)


def test_honest_probabilities_are_calibrated_and_bold_ones_are_not():
    rng = np.random.default_rng(2)
    p = rng.random(20_000)
    y = rng.random(20_000) < p
    assert expected_calibration_error(y, p) < 0.02
    assert expected_calibration_error(y, np.where(p > 0.5, 1.0, 0.0)) == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize("bad", [1.2, -0.1, np.nan])
def test_what_is_no_probability_is_refused(bad):
    with pytest.raises(ValueError, match="expected none outside 0 to 1"):
        reliability([1, 0], [bad, 0.5])
