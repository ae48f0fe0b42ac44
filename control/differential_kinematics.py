"""Joint rates for a task velocity: damped least squares within limits, a small quadratic programme."""

import numpy as np
from numpy.typing import ArrayLike
from qpsolvers import solve_qp

from pps_vision.types import Array

_SLACK_COST = 100.0  # linear cost of exceeding a row, per unit; the multipliers of tasks are below 1 (m/s)
_TOLERANCE = 1e-5  # primal tolerance; with DAQP's 1e-6 one command in a million has no solution (tests/robustness)
# Quadratic weight of the slack: the Hessian must be positive definite; with 1e-6 DAQP occasionally fails.
_SLACK_WEIGHT = 1e-4


def rate_limits(
    q: Array, lower: Array, upper: Array, max_rate: ArrayLike, approach_per_s: float
) -> tuple[Array, Array]:
    """Smallest and largest allowed rate (n,) of joints at `q` (n,) rad within limits (n,).

    A joint approaches its limit no faster than `approach_per_s` times the remaining angle, and a joint beyond its limit
    is driven back; with `approach_per_s` ≤ 1/dt no step leaves the limits.
    """
    slowest = np.clip(approach_per_s * (lower - q), -np.asarray(max_rate), max_rate)
    fastest = np.clip(approach_per_s * (upper - q), -np.asarray(max_rate), max_rate)
    return slowest, fastest


def solve_rates(
    J: Array,
    wanted: Array,
    preferred: Array,
    weights: ArrayLike,
    limits: tuple[Array, Array],
    rows: Array | None = None,
    most: ArrayLike = (),
) -> Array:
    """The rates x (n,) within `limits` that minimise ‖J x − wanted‖² + ‖weights·(x − preferred)‖², rows x ≤ most.

    J is (m, n), wanted (m,), preferred (n,), rows (k, n), most (k,); positive weights make the solution unique and
    finite also at singular postures.  Where limits and rows exclude each other, the limits hold, and the rows are
    exceeded by the smallest possible sum.  Solved by DAQP (Arnström et al. 2022) through qpsolvers; without a solution
    the rates are as near to 0 as the limits allow.
    """
    n = len(preferred)
    k = 0 if rows is None else len(rows)
    lower, upper = limits
    damping = np.broadcast_to(np.asarray(weights, dtype=float), preferred.shape) ** 2
    H = np.zeros((n + k, n + k))
    g = np.full(n + k, _SLACK_COST)
    H.ravel()[:: n + k + 1] = _SLACK_WEIGHT
    H[:n, :n] = J.T @ J + np.diag(damping)
    g[:n] = -J.T @ wanted - damping * preferred
    upper = np.maximum(lower, upper)
    lb = np.append(lower, np.zeros(k))
    ub = np.append(upper, np.full(k, np.inf))
    A = b = None
    if rows is not None and k:
        A = np.hstack([rows, -np.eye(k)])
        b = np.asarray(most, dtype=float)
    x = solve_qp(H, g, A, b, lb=lb, ub=ub, solver="daqp", primal_tol=_TOLERANCE)
    rates = np.zeros(n) if x is None else x[:n]
    return np.clip(rates, lower, upper)
