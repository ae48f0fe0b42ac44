"""How good predicted probabilities are."""

import numpy as np
from numpy.typing import ArrayLike


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
