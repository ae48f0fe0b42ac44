"""The linear model inside a receptive field: partial least squares of weighted moments."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.baselines.lwpr_fields import LITTLE, Rows
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

    def __post_init__(self) -> None:
        factors = self.first_forgetting, self.last_forgetting, self.forgetting_pace
        if not all(0 < factor < 1 for factor in factors):
            raise ValueError(f"forgetting {factors}: expected all between 0 and 1")
        if self.first_projections < 1:
            raise ValueError(f"first_projections {self.first_projections}: expected at least 1")


@dataclass(frozen=True)
class Fit:
    """What one sample did to the k fields it activates: scores s (k, inputs) and s over their weighted sum of squares,
    its leverage h (k,), the errors it leaves `e` (k,), and would if left out `e_cv` (k,)."""

    scores: Array
    scaled: Array
    leverage: Array
    e: Array
    e_cv: Array


def regress(rows: Rows, x: Array, y: Array, w: Array, params: RegressionParams) -> Fit:
    """Update the local models in place with one sample x (inputs,), `y` (k,) that activates the fields by `w` (k,)."""
    forget = rows["forgetting"].copy()
    rows["weight"] = forget * rows["weight"] + w
    rows["n_seen"] = forget * rows["n_seen"] + 1
    rows["forgetting"] += (1 - params.forgetting_pace) * (params.last_forgetting - forget)
    z, left_over = _update_moments(rows, x, y, w, forget)
    scores, scaled, e, e_cv = (np.zeros((len(rows), len(x))) for _ in range(4))
    left = np.ones(len(rows))  # 1 − h
    for r, (unit, load, slope, ss) in enumerate(_projections(rows)):
        s = (z * unit).sum(axis=1)
        scores[:, r], scaled[:, r] = s, s / ss
        left = left - w * s * scaled[:, r]
        left_over = left_over - s * slope
        z = z - s[:, None] * load
        e[:, r], e_cv[:, r] = left_over, left_over / np.maximum(left, LITTLE)
    on, last = _on(rows), (np.arange(len(rows)), rows["n_projections"] - 1)
    scores, scaled, e_last = scores * on, scaled * on, e[last]
    leverage = w * (scores * scaled).sum(axis=1)
    settled = has_settled(rows)
    if settled.any():
        w_settled = w * settled
        rows["sum_e2_cv"] = forget[:, None] * rows["sum_e2_cv"] + w_settled[:, None] * e_cv**2
        rows["sum_e2"] = forget * rows["sum_e2"] + w_settled * e_last**2
    rows["stale"] = True
    return Fit(scores, scaled, leverage, e_last, e_cv[last])


def _on(rows: Rows) -> Mask:
    """(k, inputs) the projections in use."""
    on: Mask = np.arange(rows["center"].shape[1]) < rows["n_projections"][:, None]
    return on


def _update_moments(rows: Rows, x: Array, y: Array, w: Array, forget: Array) -> tuple[Array, Array]:
    """Weighted means and co-moments about them, in place; what the sample differs from its new means by, x (k, inputs)
    and y (k,).  Kept exactly, where the paper's recursions go on summing what earlier means and directions left: the
    same in the long run, but with tens of samples a field the difference is half of the error."""
    gain = w / rows["weight"]
    off_x, off_y, old = x - rows["mean_x"], y - rows["mean_y"], 1 - gain
    rows["mean_x"] += gain[:, None] * off_x
    rows["mean_y"] += gain * off_y
    grown = (w * old)[:, None] * off_x
    rows["xx"] = forget[:, None, None] * rows["xx"] + grown[:, :, None] * off_x[:, None, :]
    rows["xy"] = forget[:, None] * rows["xy"] + grown * off_y[:, None]
    return old[:, None] * off_x, old * off_y


def _projections(rows: Rows) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Partial least squares from the co-moments, one projection after the other, as many as there are inputs: unit
    direction (k, inputs), what a score takes from the inputs (k, inputs) and the output (k,), weighted sum of squared
    scores (k,)."""
    xx, xy = rows["xx"].copy(), rows["xy"].copy()
    for _ in range(xy.shape[1]):
        length = np.sqrt((xy * xy).sum(axis=1))
        unit = xy / (length + _NO_LENGTH)[:, None]
        along = (xx @ unit[:, :, None])[:, :, 0]
        ss = (unit * along).sum(axis=1) + LITTLE
        load, slope = along / ss[:, None], length / ss
        yield unit, load, slope, ss
        xx -= along[:, :, None] * load[:, None, :]
        xy -= slope[:, None] * along


def has_settled(rows: Rows) -> Mask:
    """(fields,) which have seen enough samples for their errors to mean something."""
    settled: Mask = rows["n_seen"] * (1 - rows["forgetting"]) > 0.1
    return settled


def add_projections(rows: Rows, params: RegressionParams) -> None:
    """One more projection, in place, where the last one has earned its place and has seen enough to say so."""
    last = rows["n_projections"] - 1
    at = np.flatnonzero((last > 0) & (last < rows["center"].shape[1] - 1))
    error, error_before = (rows["sum_e2_cv"][at, r] / rows["weight"][at] + LITTLE for r in (last[at], last[at] - 1))
    adds = (error < params.add_threshold * error_before) & (rows["n_seen"][at] * (1 - rows["forgetting"][at]) > 0.5)
    rows["n_projections"][at[adds]] += 1


def is_trusted(rows: Rows, which: NDArray[np.intp] | EllipsisType = ...) -> Mask:
    """Which of the fields (`which` of them) have seen enough samples to be asked: twice as many as there are inputs."""
    trusted: Mask = rows["n_seen"][which] > 2 * rows["center"].shape[1]
    return trusted


def refresh_models(rows: Rows) -> None:
    """Work out, in place, what queries need: `offset` and `slope` of the linear model."""
    n, on = rows["center"].shape[1], _on(rows)
    rows["slope"] = 0.0
    z = np.tile(np.eye(n), (len(rows), 1, 1))  # ∂(what is left of x)/∂x
    for r, (unit, load, slope, _) in enumerate(_projections(rows)):
        s = on[:, r, None] * (unit[:, None] @ z)[:, 0]  # ∂score/∂x
        rows["slope"] += s * slope[:, None]
        z = z - load[:, :, None] * s[:, None]
    rows["offset"] = rows["mean_y"] - np.sum(rows["slope"] * rows["mean_x"], axis=1)
    rows["stale"] = False
