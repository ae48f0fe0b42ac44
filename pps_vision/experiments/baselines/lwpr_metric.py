"""How far a receptive field reaches: gradient descent on its leave-one-out error, sample by sample.

J = Σ w e²_cv / Σ w + γ/N Σ D²ᵢⱼ with D = MᵀM; the rates may follow the Incremental Delta Bar Delta rule.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from pps_vision.experiments.baselines.lwpr_fields import LITTLE, Rows
from pps_vision.experiments.baselines.lwpr_regression import Fit, has_settled
from pps_vision.types import Array, Mask

_MOST_LOG_RATE, _MOST_LOG_RATE_STEP, _MOST_STEP = 10.0, 0.1, 0.1


@dataclass(frozen=True)
class MetricParams:
    """`rate` α of the descent (0: metrics stay as they are) and `penalty` γ; `full` metrics instead of diagonal ones;
    `meta_rate` above 0 adapts the rates themselves."""

    rate: float = 50.0
    penalty: float = 1e-6
    full: bool = False
    meta_rate: float = 0.0

    def __post_init__(self) -> None:
        if not min(self.rate, self.penalty, self.meta_rate) >= 0:
            raise ValueError(
                f"rate {self.rate}, penalty {self.penalty}, meta_rate {self.meta_rate}: expected none below 0"
            )


def adapt_metric(rows: Rows, x: Array, w: Array, fit: Fit, params: MetricParams) -> None:
    """One step for the k fields that a sample x (inputs,) activates by `w` (k,), in place; none while they have seen
    too little."""
    settled = has_settled(rows)
    if not settled.any():
        return
    n, forget, e_cv2 = len(x), rows["forgetting"][:, None], fit.e_cv**2
    weight, error = rows["weight"], rows["sum_e2_cv"][np.arange(len(rows)), rows["n_projections"] - 1]
    H, R = rows["trace_h"], rows["trace_r"]
    along = e_cv2 - (fit.scaled * (fit.scaled * R + fit.e[:, None] * H)).sum(axis=1) * 2
    dJ = (along - error / weight) / weight  # ∂J/∂w
    per_left = w * settled * fit.e_cv / np.maximum(1 - fit.leverage, LITTLE)
    H *= forget
    H += per_left[:, None] * fit.scores
    R *= forget
    R += (per_left * w * fit.e_cv)[:, None] * fit.scores**2

    M = rows["metric"]
    away = x - rows["center"]
    v = (M @ away[:, :, None])[:, :, 0]
    dw = (-w[:, None] * v)[:, :, None] * away[:, None, :]  # ∂w/∂M
    D = M.swapaxes(1, 2) @ M
    share = (params.penalty / n * w / weight)[:, None, None]
    gradient = dJ[:, None, None] * dw + 4 * share * (M @ D)
    transient = np.minimum(rows["sum_e2"] / (error + LITTLE), 1.0) ** 4
    moves = _free(n, params.full) & settled[:, None, None]
    log_rate, trace = rows["log_rate"], rows["rate_trace"]
    if params.meta_rate:
        change = np.clip(-params.meta_rate * gradient * trace, -_MOST_LOG_RATE_STEP, _MOST_LOG_RATE_STEP)
        log_rate += moves * change
        np.clip(log_rate, -_MOST_LOG_RATE, _MOST_LOG_RATE, out=log_rate)
    rate = np.exp(log_rate) * transient[:, None, None]
    step = -rate * gradient
    too_far = np.abs(step) > _MOST_STEP * M.max(axis=(1, 2))[:, None, None]
    log_rate -= np.log(2) * (moves & too_far)
    moves &= ~too_far
    if params.meta_rate:
        ddJ = 2 * (fit.e**2 * (fit.scores * fit.scaled).sum(axis=1) - dJ) / weight
        ddw = (w[:, None] * (v**2 - 1))[:, :, None] * (away**2)[:, None, :]
        ddpenalty = 4 * (np.diagonal(D, axis1=1, axis2=2)[:, None, :] + (M**2).sum(axis=2)[:, :, None] + M**2)
        curvature = ddJ[:, None, None] * dw**2 + dJ[:, None, None] * ddw + share * ddpenalty
        rows["rate_trace"] = np.where(moves, trace * np.maximum(1 - rate * curvature, 0.0) + step, trace)
    M += moves * step


@cache
def _free(n: int, full: bool) -> Mask:
    """(n, n) which elements of M there are."""
    return np.triu(np.ones((n, n), dtype=bool)) if full else np.eye(n, dtype=bool)
