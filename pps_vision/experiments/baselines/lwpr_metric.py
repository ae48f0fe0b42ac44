"""How far a receptive field reaches: gradient descent on its leave-one-out error, sample by sample.

J = Σ w e²_cv / Σ w + γ/N Σ D²ᵢⱼ with D = MᵀM; the rates may follow the Incremental Delta Bar Delta rule.
"""

import math
from dataclasses import dataclass

import numpy as np

from pps_vision.experiments.baselines.lwpr_fields import (
    CENTER,
    FORGETTING,
    LITTLE,
    LOG_RATE,
    METRIC,
    N_PROJECTIONS,
    RATE_TRACE,
    SUM_E2,
    SUM_E2_CV,
    TRACE_H,
    TRACE_R,
    WEIGHT,
    Groups,
)
from pps_vision.experiments.baselines.lwpr_regression import Fit, dot, has_settled
from pps_vision.jit import njit
from pps_vision.types import Array

_MOST_LOG_RATE, _MOST_LOG_RATE_STEP, _MOST_STEP = 10.0, 0.1, 0.1


@dataclass(frozen=True)
class MetricParams:
    """`rate` α of the descent (0: metrics stay as they are) and `penalty` γ; `full` metrics instead of diagonal ones;
    `meta_rate` above 0 adapts the rates themselves."""

    rate: float = 50.0
    penalty: float = 1e-6
    full: bool = False
    meta_rate: float = 0.0


@njit(cache=True, error_model="numpy")
def adapt_metric(row: Groups, x: Array, w: float, fit: Fit, penalty: float, full: bool, meta_rate: float) -> None:
    """One step for a field that a sample x (inputs,) activates by `w`, in place; none while it has seen too little."""
    if not has_settled(row):
        return
    n, weight, error, dJ = len(x), row.scalars[WEIGHT], row.vectors[SUM_E2_CV, row.whole[N_PROJECTIONS] - 1], 0.0
    for r in range(n):
        dJ += fit.scaled[r] * (fit.scaled[r] * row.vectors[TRACE_R, r] + fit.e * row.vectors[TRACE_H, r])
    dJ = (fit.e_cv**2 - 2 * dJ - error / weight) / weight  # ∂J/∂w
    per_left = w * fit.e_cv / max(1 - fit.leverage, LITTLE)
    for r in range(n):
        row.vectors[TRACE_H, r] = row.scalars[FORGETTING] * row.vectors[TRACE_H, r] + per_left * fit.scores[r]
        row.vectors[TRACE_R, r] = (
            row.scalars[FORGETTING] * row.vectors[TRACE_R, r] + per_left * w * fit.e_cv * fit.scores[r] ** 2
        )

    M, away, v = row.matrices[METRIC].copy(), x - row.vectors[CENTER], np.zeros(n)
    D, squares = np.zeros((n, n)), np.zeros(n)  # MᵀM; Σ_k M_ik²
    for i in range(n):
        v[i] = dot(M[i], away)
        squares[i] = dot(M[i], M[i])
        for j in range(n):
            D[i, j] = dot(M[:, i], M[:, j])
    share = penalty / n * w / weight
    transient = min(row.scalars[SUM_E2] / (error + LITTLE), 1.0) ** 4
    most_step = _MOST_STEP * M.max()
    ddJ = 2 * (fit.e**2 * dot(fit.scores, fit.scaled) - dJ) / weight
    for i in range(n):
        for j in range(i, n if full else i + 1):
            dw = -w * v[i] * away[j]  # ∂w/∂M
            gradient = dJ * dw + 4 * share * dot(M[i], D[:, j])
            trace = row.matrices[RATE_TRACE, i, j]
            if meta_rate:
                change = min(max(-meta_rate * gradient * trace, -_MOST_LOG_RATE_STEP), _MOST_LOG_RATE_STEP)
                row.matrices[LOG_RATE, i, j] = min(
                    max(row.matrices[LOG_RATE, i, j] + change, -_MOST_LOG_RATE), _MOST_LOG_RATE
                )
            own_rate = math.exp(row.matrices[LOG_RATE, i, j]) * transient
            step = -own_rate * gradient
            if abs(step) > most_step:
                row.matrices[LOG_RATE, i, j] -= math.log(2)
                continue
            if meta_rate:
                ddw = w * (v[i] ** 2 - 1) * away[j] ** 2
                ddpenalty = 4 * (D[j, j] + squares[i] + M[i, j] ** 2)
                curvature = ddJ * dw**2 + dJ * ddw + share * ddpenalty
                row.matrices[RATE_TRACE, i, j] = trace * max(1 - own_rate * curvature, 0.0) + step
            row.matrices[METRIC, i, j] = M[i, j] + step
