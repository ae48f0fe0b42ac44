"""The linear model inside a receptive field: partial least squares by recursive statistics."""

from dataclasses import dataclass

import numpy as np

from learning.lwpr_fields import LITTLE, Rows
from pps_vision.types import Array, Mask

_NO_LENGTH = 1e-300


@dataclass(frozen=True)
class RegressionParams:
    """The forgetting factor goes from `first_forgetting` to `last_forgetting`, by 1 − `forgetting_pace` of the way a
    sample.  A projection is added where the last one left less than `add_threshold` of the error."""

    first_forgetting: float = 0.999
    last_forgetting: float = 0.99999
    forgetting_pace: float = 0.9999
    add_threshold: float = 0.5

    def __post_init__(self) -> None:
        factors = self.first_forgetting, self.last_forgetting, self.forgetting_pace
        if not all(0 < factor < 1 for factor in factors):
            raise ValueError(f"forgetting {factors}: expected all between 0 and 1")


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
    n_projections, seen = rows["n_projections"], rows["n_seen"]
    on = (np.arange(len(x)) < n_projections[:, None]).astype(float)
    forget, weight = rows["forgetting"].copy(), rows["weight"]
    weight *= forget
    weight += w[:, None] * on
    seen *= forget
    seen += on
    rows["forgetting"] += (1 - params.forgetting_pace) * (params.last_forgetting - forget) * on
    gain, mean_x, mean_y = w / weight[:, 0], rows["mean_x"], rows["mean_y"]
    mean_x += gain[:, None] * (x - mean_x)
    mean_y += gain * (y - mean_y)
    z, residual = x - mean_x, y - mean_y
    slow = 0.9 + 0.1 * forget
    ss_xy, ss_s, ss_sy, ss_sx = (rows[name] for name in ("ss_xy", "ss_s", "ss_sy", "ss_sx"))
    scores, scaled, e_cv = np.zeros(on.shape), np.zeros(on.shape), np.zeros(on.shape)
    left = np.ones(len(rows))  # 1 − h
    for r in range(int(n_projections.max())):
        f, direction = forget[:, r], slow[:, r, None] * ss_xy[:, r] + (w * residual)[:, None] * z
        s = on[:, r] * (z * direction).sum(axis=1) / (np.sqrt((direction * direction).sum(axis=1)) + _NO_LENGTH)
        ws = w * s
        ss, sy = f * ss_s[:, r] + ws * s, f * ss_sy[:, r] + ws * residual
        sx = f[:, None] * ss_sx[:, r] + ws[:, None] * z
        ss_xy[:, r], ss_s[:, r], ss_sy[:, r], ss_sx[:, r] = direction, ss, sy, sx
        scores[:, r], scaled[:, r] = s, s / ss
        left -= ws * scaled[:, r]
        residual = residual - s * sy / ss
        z = z - (s / ss)[:, None] * sx
        e_cv[:, r] = residual / np.maximum(left, LITTLE)
    rows["sum_p"] = forget[:, 0] * rows["sum_p"] + w * (1 - left)
    rows["sum_residual2"] = forget[:, 0] * rows["sum_residual2"] + w * residual**2
    settled = has_settled(rows)
    if settled.any():
        w_settled = w * settled
        rows["sum_e2_cv"] = forget * rows["sum_e2_cv"] + w_settled[:, None] * e_cv**2
        rows["sum_e2"] = forget[:, 0] * rows["sum_e2"] + w_settled * residual**2
    return Fit(scores, scaled, 1 - left, residual, e_cv[np.arange(len(rows)), n_projections - 1])


def has_settled(rows: Rows) -> Mask:
    """(fields,) which have seen enough samples for their errors to mean something."""
    settled: Mask = rows["n_seen"][:, 0] * (1 - rows["forgetting"][:, 0]) > 0.1
    return settled


def add_projections(rows: Rows, params: RegressionParams) -> None:
    """One more projection, in place, where the last one has earned its place and has seen enough to say so."""
    n, last = rows["center"].shape[1], rows["n_projections"] - 1
    at = np.flatnonzero((last > 0) & (last < n - 1))
    if not len(at):
        return
    last = last[at]
    seen = rows["n_seen"][at, last]
    error, error_before = (rows["sum_e2_cv"][at, r] / rows["weight"][at, r] + LITTLE for r in (last, last - 1))
    adds = (
        (error < params.add_threshold * error_before)
        & (seen > 0.99 * rows["n_seen"][at, 0])
        & (seen * (1 - rows["forgetting"][at, last]) > 0.5)
    )
    at, r = at[adds], last[adds] + 1
    rows["n_projections"][at] += 1
    rows["weight"][at, r] = rows["ss_s"][at, r] = LITTLE
    rows["n_seen"][at, r] = 0.0
    rows["forgetting"][at, r] = params.first_forgetting


def is_trusted(rows: Rows) -> Mask:
    """(fields,) which have seen enough samples to be asked: twice as many as there are inputs."""
    return rows["n_seen"][:, 0] > 2 * rows["center"].shape[1]


def linear_models(rows: Rows) -> tuple[Array, Array, Array]:
    """Offsets (fields,), slopes (fields, inputs) and score directions (fields, projections, inputs), scaled so that the
    squared scores of x − mean_x add up to s Pₛ s; a last projection that has seen too little does not count."""
    n = rows["center"].shape[1]
    counts = (np.arange(n) < rows["n_projections"][:, None]) & ((rows["n_seen"] > 2 * n) | (np.arange(n) == 0))
    slopes, directions = np.zeros((len(rows), n)), np.zeros((len(rows), n, n))
    z = np.tile(np.eye(n), (len(rows), 1, 1))  # ∂(what is left of x)/∂x
    for r in range(int(rows["n_projections"].max(initial=0))):
        direction = rows["ss_xy"][:, r]
        length = np.sqrt(np.sum(direction**2, axis=1))
        unit = direction * (counts[:, r] / np.where(length > 0, length, 1.0))[:, None]
        s = (unit[:, None] @ z)[:, 0]  # ∂score/∂x
        ss = rows["ss_s"][:, r, None]
        slopes += s * rows["ss_sy"][:, r, None] / ss
        directions[:, r] = s / np.sqrt(ss)
        z = z - (rows["ss_sx"][:, r] / ss)[:, :, None] * s[:, None]
    offsets = rows["mean_y"] - np.sum(slopes * rows["mean_x"], axis=1)
    return offsets, slopes, directions
