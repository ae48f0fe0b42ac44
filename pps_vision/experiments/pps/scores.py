"""Scores of predicted probabilities: discrimination, Brier score, calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from pps_vision.types import Array

_BINS = 10  # of a reliability diagram


def auroc(outcome: ArrayLike, score: ArrayLike) -> float:
    """Area under the receiver operating characteristic: how often a positive outcome scores above a
    negative one, ties counting half.  NaN where all outcomes are the same."""
    positive = np.asarray(outcome, dtype=bool).ravel()
    scores = np.asarray(score, dtype=float).ravel()
    values, inverse = np.unique(scores, return_inverse=True)
    n_positive = np.bincount(inverse[positive], minlength=len(values))
    n_negative = np.bincount(inverse[~positive], minlength=len(values))
    below = np.cumsum(n_negative) - n_negative
    pairs = n_positive.sum() * n_negative.sum()
    return float((n_positive * (below + 0.5 * n_negative)).sum() / pairs) if pairs else float("nan")


def brier(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Mean squared difference between predicted probability and outcome (0 or 1)."""
    return float(np.mean((np.asarray(probability, dtype=float) - np.asarray(outcome, dtype=float)) ** 2))


def brier_gain(outcome: ArrayLike, probability: ArrayLike, reference: ArrayLike) -> tuple[float, float, float]:
    """By how much the Brier score is below that of the reference, and the 95 % interval over the independent units
    (Student's t of the paired differences); arguments (units, values of each), as (trials, taxels), at least two units.
    """
    y, p, q = (np.asarray(a, dtype=float) for a in (outcome, probability, reference))
    gains = np.mean((q - y) ** 2 - (p - y) ** 2, axis=1)
    half = float(stdtrit(len(gains) - 1, 0.975) * gains.std(ddof=1) / np.sqrt(len(gains)))
    mean = float(gains.mean())
    return mean, mean - half, mean + half


@dataclass(frozen=True)
class Reliability:
    """Reliability diagram: the bins of equal width that hold predictions."""

    predicted: Array
    """(bins,) mean predicted probability."""
    happened: Array
    """(bins,) share of positive outcomes."""
    n: NDArray[np.intp]
    """(bins,) number of predictions."""


def reliability(outcome: ArrayLike, probability: ArrayLike) -> Reliability:
    """The reliability diagram of predicted probabilities; ValueError for one outside [0, 1]."""
    p, y = np.asarray(probability, dtype=float).ravel(), np.asarray(outcome, dtype=float).ravel()
    if not np.all((p >= 0) & (p <= 1)):
        raise ValueError(f"probabilities from {p.min()} to {p.max()}: expected none outside 0 to 1")
    which = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    n = np.bincount(which, minlength=_BINS)
    held = n > 0
    predicted, happened = (np.bincount(which, weights=a, minlength=_BINS)[held] / n[held] for a in (p, y))
    return Reliability(predicted, happened, n[held])


def expected_calibration_error(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Mean over the predictions of the distance between predicted probability and share of positives in their bin."""
    r = reliability(outcome, probability)
    return float(np.sum(r.n * np.abs(r.predicted - r.happened)) / np.sum(r.n))
