"""The linear model inside a receptive field: partial least squares of weighted moments, compiled by numba."""

import math
from dataclasses import dataclass
from types import EllipsisType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.baselines.lwpr_fields import (
    CENTER,
    FORGETTING,
    LITTLE,
    MEAN_X,
    MEAN_Y,
    N_PROJECTIONS,
    N_SEEN,
    OFFSET,
    SLOPE,
    STALE,
    SUM_E2,
    SUM_E2_CV,
    WEIGHT,
    XX,
    XY,
    Groups,
    Rows,
    row_of,
)
from pps_vision.jit import njit
from pps_vision.types import Array, Mask

_NO_LENGTH = 1e-300


@dataclass(frozen=True)
class RegressionParams:
    """The forgetting factor goes from `first_forgetting` to `last_forgetting`, by 1 − `forgetting_pace` of the way a
    sample.  A field is born with `first_projections` (at most one an input; the paper's two let the second prove its
    worth); one is added where the last left less than `add_threshold` of the error."""

    first_forgetting: float = 0.999
    last_forgetting: float = 0.99999
    forgetting_pace: float = 0.9999
    add_threshold: float = 0.5
    first_projections: int = 2


class Fit(NamedTuple):
    """What one sample did to a field that it activates: scores s (inputs,) and s over their weighted sum of squares,
    its leverage h, the error it leaves, and the one it would if left out."""

    scores: Array
    scaled: Array
    leverage: float
    e: float
    e_cv: float


@njit(cache=True, error_model="numpy")
def regress(row: Groups, x: Array, y: float, w: float, forgetting: tuple[float, float]) -> Fit:
    """Update a field's local model in place with one sample x (inputs,), y that activates it by `w`; `forgetting`: its
    last factor and its pace."""
    n, forget = len(x), row.scalars[FORGETTING]
    row.scalars[WEIGHT] = forget * row.scalars[WEIGHT] + w
    row.scalars[N_SEEN] = forget * row.scalars[N_SEEN] + 1
    row.scalars[FORGETTING] += (1 - forgetting[1]) * (forgetting[0] - forget)
    z = np.empty(n)
    left_over = _update_moments(row, x, y, w, forget, z)
    xx, xy, unit, load = row.matrices[XX].copy(), row.vectors[XY].copy(), np.empty(n), np.empty(n)
    scores, scaled, e_cv = np.zeros(n), np.zeros(n), np.empty(n)
    left, leverage, e = 1.0, 0.0, 0.0  # left: 1 − h of all projections so far
    for r in range(n):
        ss, slope = project(xx, xy, unit, load)
        s = dot(z, unit)
        left -= w * s * s / ss
        left_over -= s * slope
        for i in range(n):
            z[i] -= s * load[i]
        e_cv[r] = left_over / max(left, LITTLE)
        if r < row.whole[N_PROJECTIONS]:
            scores[r], scaled[r], e = s, s / ss, left_over
            leverage += w * s * s / ss
    if has_settled(row):
        for r in range(n):
            row.vectors[SUM_E2_CV, r] = forget * row.vectors[SUM_E2_CV, r] + w * e_cv[r] ** 2
        row.scalars[SUM_E2] = forget * row.scalars[SUM_E2] + w * e**2
    row.whole[STALE] = 1
    return Fit(scores, scaled, leverage, e, e_cv[row.whole[N_PROJECTIONS] - 1])


@njit(cache=True, error_model="numpy")
def dot(a: Array, b: Array) -> float:
    """Σ a b of short vectors."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(cache=True, error_model="numpy")
def _update_moments(row: Groups, x: Array, y: float, w: float, forget: float, z: Array) -> float:
    """Weighted means and co-moments about them, in place; what the sample differs from its new means by, `z` (inputs,)
    and returned for y.  Kept exactly, where the paper's recursions go on summing what earlier means and directions
    left: the same in the long run, but with tens of samples a field the difference is half of the error."""
    gain = w / row.scalars[WEIGHT]
    old, off_y = 1 - gain, y - row.scalars[MEAN_Y]
    row.scalars[MEAN_Y] += gain * off_y
    for i in range(len(x)):
        z[i] = x[i] - row.vectors[MEAN_X, i]
        row.vectors[MEAN_X, i] += gain * z[i]
    for i in range(len(x)):
        grown = w * old * z[i]
        for j in range(len(x)):
            row.matrices[XX, i, j] = forget * row.matrices[XX, i, j] + grown * z[j]
        row.vectors[XY, i] = forget * row.vectors[XY, i] + grown * off_y
    for i in range(len(x)):
        z[i] *= old
    difference: float = old * off_y
    return difference


@njit(cache=True, error_model="numpy")
def project(xx: Array, xy: Array, unit: Array, load: Array) -> tuple[float, float]:
    """The next projection of partial least squares, which is taken from the co-moments in place.

    Written: its `unit` direction (inputs,), and `load` (inputs,), what a score takes from the inputs.  Returned: the
    weighted sum of squared scores, and what a score takes from the output."""
    n, length = len(xy), math.sqrt(dot(xy, xy))
    for i in range(n):
        unit[i] = xy[i] / (length + _NO_LENGTH)
    ss = LITTLE
    for i in range(n):
        load[i] = dot(xx[i], unit)
        ss += unit[i] * load[i]
    slope = length / ss
    for i in range(n):
        xy[i] -= slope * load[i]
    for i in range(n):
        for j in range(n):
            xx[i, j] -= load[i] * load[j] / ss
    for i in range(n):
        load[i] /= ss
    return ss, slope


@njit(cache=True, error_model="numpy")
def has_settled(row: Groups) -> bool:
    """Whether a field has seen enough samples for its errors to mean something."""
    settled: bool = row.scalars[N_SEEN] * (1 - row.scalars[FORGETTING]) > 0.1
    return settled


@njit(cache=True, error_model="numpy")
def add_projection(row: Groups, add_threshold: float) -> None:
    """One more projection, in place, where the last one has earned its place and has seen enough to say so."""
    last = row.whole[N_PROJECTIONS] - 1
    if 0 < last < len(row.vectors[CENTER]) - 1:
        error = row.vectors[SUM_E2_CV, last] / row.scalars[WEIGHT] + LITTLE
        error_before = row.vectors[SUM_E2_CV, last - 1] / row.scalars[WEIGHT] + LITTLE
        if error < add_threshold * error_before and row.scalars[N_SEEN] * (1 - row.scalars[FORGETTING]) > 0.5:
            row.whole[N_PROJECTIONS] += 1


def is_trusted(rows: Rows, which: NDArray[np.intp] | EllipsisType = ...) -> Mask:
    """Which of the fields (`which` of them) have seen enough samples to be asked: twice as many as there are inputs."""
    trusted: Mask = rows["n_seen"][which] > 2 * rows["center"].shape[1]
    return trusted


@njit(cache=True, error_model="numpy")
def refresh_models(table: Groups, which: NDArray[np.intp]) -> None:
    """Work out, in place, what queries need of some fields: `offset` and `slope` of the linear model."""
    for k in which:
        row = row_of(table, k)
        n = len(row.vectors[CENTER])
        xx, xy, unit, load = row.matrices[XX].copy(), row.vectors[XY].copy(), np.empty(n), np.empty(n)
        z, s = np.eye(n), np.empty(n)  # ∂(what is left of x)/∂x, ∂score/∂x
        row.vectors[SLOPE, :] = 0.0
        for _ in range(row.whole[N_PROJECTIONS]):
            _, slope = project(xx, xy, unit, load)
            for j in range(n):
                s[j] = dot(unit, z[:, j])
                row.vectors[SLOPE, j] += s[j] * slope
            for i in range(n):
                for j in range(n):
                    z[i, j] -= load[i] * s[j]
        row.scalars[OFFSET] = row.scalars[MEAN_Y] - dot(row.vectors[SLOPE], row.vectors[MEAN_X])
        row.whole[STALE] = 0
