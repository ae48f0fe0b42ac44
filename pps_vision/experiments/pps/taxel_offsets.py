"""Systematic offset of each taxel, read from its map (R, "Analysis of the systematic errors", Fig 8).

The regression line through the positive samples in (D, TTC) gives the distance that is perceived at the touch, where it
crosses TTC = 0.  Without errors this is the radius of the object.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from learning.pps.memory import PPSMemory
from pps_vision.types import Array


@dataclass(frozen=True)
class Line:
    """x = `offset` + `slope` · y."""

    offset: float
    slope: float


def orthogonal_line(x: ArrayLike, y: ArrayLike, weights: ArrayLike) -> Line | None:
    """The line with the least weighted sum of squared orthogonal distances from points (n,); None where no line, or one
    along x, fits best.  ValueError for weights that are negative or not as many as points."""
    x, y, w = (np.asarray(a, dtype=float).ravel() for a in (x, y, weights))
    if not (x.shape == y.shape == w.shape and np.all(w >= 0)):
        raise ValueError(f"{x.size} x, {y.size} y, {w.size} weights: expected as many of each, no weight negative")
    if w.sum() == 0:
        return None
    points = np.stack([x, y])
    middle = points @ w / w.sum()
    spread = points - middle[:, None]
    variances, directions = np.linalg.eigh((spread * w) @ spread.T)
    along_x, along_y = directions[:, 1]
    if variances[1] - variances[0] <= 1e-12 * variances[1] or abs(along_y) < 1e-9:
        return None
    slope = along_x / along_y
    return Line(float(middle[0] - slope * middle[1]), float(slope))


def offsets(memory: PPSMemory, weights: Array | None = None) -> Array:
    """(n,) m: the distance at which each taxel's line crosses TTC = 0, NaN where there is none.

    Args:
        memory: Map of n taxels.
        weights: (n, D bins, TTC bins) of the bins' centres; default: the positive samples that they hold.  R weights
            by f: pass `memory.frequency`.

    The axes are in metres and seconds, in which nearly all of the scatter is along the distance, as it is in the data.
    """
    (d0, d1), (t0, t1) = memory.params.distance_range_m, memory.params.ttc_range_s
    n_distance, n_ttc = memory.params.bins
    distance = d0 + (np.arange(n_distance) + 0.5) * (d1 - d0) / n_distance
    ttc = t0 + (np.arange(n_ttc) + 0.5) * (t1 - t0) / n_ttc
    x, y = np.meshgrid(distance, ttc, indexing="ij")
    of_taxel = memory.counts[..., 0] if weights is None else weights
    lines = [orthogonal_line(x, y, w) for w in of_taxel]
    return np.array([np.nan if line is None else line.offset for line in lines])
