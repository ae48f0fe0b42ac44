"""The regression line of a map against a search and a known offset; scores of probabilities against SciPy."""

import numpy as np
import pytest
from data import SEED
from scipy.optimize import minimize
from scipy.stats import mannwhitneyu, ttest_rel

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.pps.ridges import FINE, bin_centers, offsets, orthogonal_line, ridge_width
from pps_vision.experiments.pps_prediction import auroc, brier, brier_gain, expected_calibration_error


def test_the_line_is_that_of_a_search_for_the_least_distance():
    rng = np.random.default_rng(SEED)
    y = rng.uniform(0, 3, 60)
    x = 0.4 + 0.3 * y + 0.1 * rng.standard_normal(60)
    weights = rng.uniform(0.1, 2.0, 60)

    def cost(line: np.ndarray) -> float:
        return float(weights @ ((x - line[0] - np.tan(line[1]) * y) * np.cos(line[1])) ** 2)

    best = minimize(cost, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    np.testing.assert_allclose(orthogonal_line(x, y, weights), [best[0], np.tan(best[1])], atol=1e-5)


def test_the_offset_of_objects_at_many_speeds():
    offset_m = 0.05
    rng = np.random.default_rng(SEED)
    left_s = np.tile(np.arange(0.025, 0.4, 0.05), 200)
    distance = offset_m + np.repeat(rng.uniform(0.05, 0.15, 200), 8) * left_s
    samples = (np.stack([distance, np.full(len(left_s), np.nan)], axis=1), np.stack([left_s, left_s], axis=1))
    memory = count_samples(empty_map(2, MemoryParams(ttc_range_s=(0.0, 0.4), bins=(60, 8))), *samples, np.ones(2, bool))
    estimates = offsets(memory)
    assert abs(estimates[0] - offset_m) < 0.003
    assert np.isnan(estimates[1])


def test_offset_and_width_of_worked_out_counts():
    """Bins of 0.1 m and 1 s from 0 m and 0.5 s: 0.05 m at 1 s and 0.15 m at 2 s; a ridge two bins wide."""
    counts = np.zeros((1, 3, 2, 2), np.int64)
    counts[0, [0, 1], [0, 1], 0] = 3
    assert offsets(PPSMemory(("a",), np.zeros(1, np.intp), counts, MemoryParams((0.0, 0.3), (0.5, 2.5), (3, 2)))) == (
        pytest.approx(-0.05)
    )
    ridge = np.zeros((*FINE.bins, 2))
    ridge[[60, 61], 10:50, 0] = 1
    assert ridge_width(ridge) == pytest.approx(np.std(bin_centers(FINE)[0][60:62, 0]))


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
