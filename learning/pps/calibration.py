"""Predictions that mean what they say: a map from what is predicted to how often it happens."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression

from pps_vision.types import Array


@dataclass(frozen=True)
class Calibration:
    """How often it happened, `happened` (k,), when a probability `said` (k,) was predicted, both rising."""

    said: Array
    happened: Array

    def __call__(self, probability: ArrayLike) -> Array:
        """Corrected probabilities, interpolated."""
        return np.interp(np.asarray(probability, dtype=float), self.said, self.happened)


def calibrate(outcome: ArrayLike, probability: ArrayLike) -> Calibration:
    """Isotonic regression of outcomes on predictions, any shape: the rising curve nearest to what happened.

    Predictions must be of what was not learned from.  ValueError without a prediction.
    """
    y, p = np.asarray(outcome, dtype=float).ravel(), np.asarray(probability, dtype=float).ravel()
    if p.size == 0 or p.shape != y.shape or not np.isfinite(p).all():
        raise ValueError(f"{y.size} outcomes and {p.size} predictions: expected as many of each, at least one, no NaN")
    said, which, n = np.unique(np.round(p, 3), return_inverse=True, return_counts=True)
    found = isotonic_regression(np.bincount(which, weights=y) / n, weights=n).x
    return Calibration(said, np.asarray(found))
