"""Scores of predicted probabilities: discrimination, Brier score, calibration."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit
from scipy.stats import rankdata, sem

_BINS = 10  # reliability diagram


def auroc(outcome: ArrayLike, score: ArrayLike) -> float:
    """Return the area under the receiver operating characteristic; NaN where all outcomes are equal.

    It is the share of pairs of a positive and a negative outcome in which the positive scores higher; ties count half.
    """
    is_positive = np.asarray(outcome, dtype=bool).ravel()
    n = np.count_nonzero(is_positive)
    if n in (0, len(is_positive)):
        return np.nan
    return float((rankdata(score)[is_positive].mean() - (n + 1) / 2) / (len(is_positive) - n))


def brier(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean squared difference between predicted probability and outcome (0 or 1)."""
    return float(np.mean((np.asarray(probability, dtype=float) - np.asarray(outcome, dtype=float)) ** 2))


def brier_gain(outcome: ArrayLike, probability: ArrayLike, reference: ArrayLike) -> tuple[float, float, float]:
    """Return the Brier score of the reference less that of the prediction, with its 95 % interval.

    The arguments are (units, values of each unit); the interval is Student's t of the paired differences of two or more
    independent units.
    """
    y, p, q = (np.asarray(values, dtype=float) for values in (outcome, probability, reference))
    gains = np.mean((q - y) ** 2 - (p - y) ** 2, axis=1)
    half = float(stdtrit(len(gains) - 1, 0.975) * sem(gains))
    return float(gains.mean()), float(gains.mean()) - half, float(gains.mean()) + half


def expected_calibration_error(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean distance between predicted probability and share of positives in its bin (ten equal bins)."""
    p = np.asarray(probability, dtype=float).ravel()
    index = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    return float(np.abs(np.bincount(index, weights=p - np.ravel(outcome))).sum() / len(p))
