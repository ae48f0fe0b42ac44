"""Scores against SciPy and worked-out cases."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from learning.scores import auroc, brier


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
