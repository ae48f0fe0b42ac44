"""Intervals of measured shares."""

import numpy as np
from scipy.stats import binomtest


def percent_of(counted: int, n: int) -> list[float]:
    """Return the percentage of n independent units that count, with Wilson's 95 % interval; NaN of none."""
    if not n:
        return [np.nan] * 3
    ends = binomtest(counted, n).proportion_ci(method="wilson")
    return [100 * float(value) for value in (counted / n, ends.low, ends.high)]
