"""R's table of counts, learned from samples at once, with two variants: a normalised activation, and counts shared
between neighbouring taxels."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples, windows
from pps_vision.types import Array, Mask

Predict = Callable[[Array, Array], Array]
"""D and TTC (…, n) → probability of touch (…, n), 0 for NaN."""


@dataclass(frozen=True)
class CountTable:
    """Table of counts over D and TTC (R eqs 3–5); one bin of TTC is the distance-only model."""

    params: MemoryParams
    """Ranges, bins and window."""
    normalised: bool = False
    """Smooth positives and all samples separately, then divide: bins without a sample have no weight.  R smooths the
    ratio, so that they count as 0."""
    pooled: float = 0.0
    """Weight of the samples of every other taxel; 0: each taxel counts its own only (R)."""

    def fit(self, distance_m: Array, ttc_s: Array, touched: Mask) -> Predict:
        """Count samples D and TTC (N, n), NaN where nothing was perceived, with their outcomes `touched` (N, n)."""
        memory = counted(self.params, distance_m, ttc_s, touched)
        if self.pooled:
            own = (1 - self.pooled) * memory.counts
            memory = replace(memory, counts=own + self.pooled * memory.counts.sum(axis=0))
        if not self.normalised:
            return lambda distance, ttc: activation(memory, distance, ttc)
        return lambda distance, ttc: _ratio(memory, distance, ttc)


def counted(params: MemoryParams, distance_m: Array, ttc_s: Array, touched: Mask) -> PPSMemory:
    """A memory of samples (N, n), all taxels on one body part; samples that ended in no touch count too."""
    n = distance_m.shape[1]
    names, every = tuple(str(i) for i in range(n)), np.ones(n, bool)
    apart = PPSMemory(names, np.arange(n), np.zeros((n, *params.bins, 2), np.int64), params)
    positive, negative = (
        count_samples(apart, np.where(chosen, distance_m, np.nan), ttc_s, every).counts[..., 0].astype(np.int64)
        for chosen in (touched, ~touched)
    )
    return PPSMemory(names, np.zeros(n, np.intp), np.stack([positive, negative], axis=-1), params)


def _ratio(memory: PPSMemory, distance_m: Array, ttc_s: Array) -> Array:
    inside = memory.params.covers(distance_m, ttc_s)
    found = np.zeros(inside.shape)
    at = np.nonzero(inside)
    w_distance, w_ttc = windows(memory.params, distance_m, ttc_s, inside)
    seen = np.einsum("kd,kdtc,kt->kc", w_distance, memory.counts[at[-1]].astype(float), w_ttc)
    found[at] = seen[:, 0] / np.maximum(seen.sum(axis=1), 1e-12)
    return found
