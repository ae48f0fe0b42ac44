"""How sure an activation is: an interval from the counts behind it, so that one lucky trial is not certainty."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv

from learning.pps.memory import PPSMemory, activation, paired, windows
from pps_vision.types import Array

SAMPLES_PER_TRIAL = 4.0
"""A trial leaves several samples in a cell (six on average at 50 ms), all with one outcome: this many count as one.
With it 90 % intervals cover what the map settles on in 96–100 % of cases after 1 to 200 trials, with 1 in 83–94 %."""
_PRIOR = 0.5  # Jeffreys: half a touch and half a miss in every cell


def activation_interval(
    memory: PPSMemory,
    distance_m: ArrayLike,
    ttc_s: ArrayLike,
    level: float = 0.9,
    samples_per_trial: float = SAMPLES_PER_TRIAL,
) -> tuple[Array, Array]:
    """Lower and upper end (…, n) of where each taxel's activation at D and TTC (…, n) will settle.

    In every cell the probability of touch follows Beta(n⁺ + ½, n⁻ + ½), samples in units of
    `samples_per_trial`; the Parzen window of R eqs 4–5 averages the cells' means and, since one trial passes
    through neighbouring cells with one outcome, their standard deviations; the interval is that of the Beta
    distribution with this mean and deviation, and holds the activation.  (0, 1) where that is 0 because
    nothing is known: outside the ranges and for NaN.
    """
    if not 0 < level < 1:
        raise ValueError(f"level {level}: expected a share between 0 and 1")
    if not samples_per_trial > 0:
        raise ValueError(f"samples_per_trial {samples_per_trial}: expected a number above 0")
    distance, ttc = paired(memory, distance_m, ttc_s)
    inside = memory.params.covers(distance, ttc)
    at = np.nonzero(inside)
    lower, upper = np.zeros(inside.shape), np.ones(inside.shape)
    w_distance, w_ttc = windows(memory.params, distance, ttc, inside)
    evidence = memory.counts[at[-1]] / samples_per_trial + _PRIOR  # (k, D bins, TTC bins, 2)
    a, b = evidence[..., 0], evidence[..., 1]
    mean, std = (
        np.einsum("kd,kdt,kt->k", w_distance, of_cell, w_ttc)
        for of_cell in (a / (a + b), np.sqrt(a * b / (a + b + 1)) / (a + b))
    )
    weight = mean * (1 - mean) / std**2 - 1
    expected = activation(memory, distance, ttc)[at]
    lower[at], upper[at] = (
        widen(betaincinv(mean * weight, (1 - mean) * weight, share), expected)
        for widen, share in ((np.minimum, 0.5 * (1 - level)), (np.maximum, 0.5 * (1 + level)))
    )
    return lower, upper
