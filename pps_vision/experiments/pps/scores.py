"""Scores of predicted probabilities: discrimination, Brier score, calibration."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

_BINS = 10  # reliability diagram


def auroc(outcome: ArrayLike, score: ArrayLike) -> float:
    """Return the area under the receiver operating characteristic; NaN where all outcomes are equal.

    It is the share of pairs of a positive and a negative outcome in which the positive scores higher; ties count half.
    """
    positive = np.asarray(outcome, dtype=bool).ravel()
    values, index = np.unique(np.asarray(score, dtype=float).ravel(), return_inverse=True)
    n_positive = np.bincount(index[positive], minlength=len(values))
    n_negative = np.bincount(index[~positive], minlength=len(values))
    below = np.cumsum(n_negative) - n_negative
    pairs = n_positive.sum() * n_negative.sum()
    return float((n_positive * (below + 0.5 * n_negative)).sum() / pairs) if pairs else float("nan")


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
    half = float(stdtrit(len(gains) - 1, 0.975) * gains.std(ddof=1) / np.sqrt(len(gains)))
    mean = float(gains.mean())
    return mean, mean - half, mean + half


def expected_calibration_error(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean distance between predicted probability and share of positives in its bin (ten equal bins)."""
    p = np.asarray(probability, dtype=float).ravel()
    y = np.asarray(outcome, dtype=float).ravel()
    index = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    differences = np.bincount(index, weights=p, minlength=_BINS) - np.bincount(index, weights=y, minlength=_BINS)
    return float(np.abs(differences).sum() / len(p))
