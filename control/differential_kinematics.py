"""Joint rates for a task velocity: damped least squares within limits, a small quadratic programme."""

import numpy as np
from numpy.typing import ArrayLike
from qpsolvers import solve_qp

from pps_vision.types import Array

_PRICE = 100.0  # of leaving a row, per unit; the multipliers of tasks are below 1 (m/s)
_TOLERANCE = 1e-5  # of a row or bound; with DAQP's 1e-6 one command of a million has no solution
# Of the rows' slack in the Hessian, which must be positive definite; with 1e-6 DAQP now and then finds no solution.
_SLACK_WEIGHT = 1e-4


def rate_limits(
    q: Array, lower: Array, upper: Array, max_rate: ArrayLike, approach_per_s: float
) -> tuple[Array, Array]:
    """Smallest and largest allowed rate (n,) of joints at `q` (n,) rad within limits (n,).

    A joint nears its limit no faster than `approach_per_s` times the angle left, and a joint beyond its limit is
    driven back; with `approach_per_s` ≤ 1/dt no step leaves the limits.
    """
    slowest = np.clip(approach_per_s * (lower - q), -np.asarray(max_rate), max_rate)
    fastest = np.clip(approach_per_s * (upper - q), -np.asarray(max_rate), max_rate)
    return slowest, fastest


def within_change(limits: tuple[Array, Array], before: Array, change: Array) -> tuple[Array, Array]:
    """Limits (n,) narrowed to what is within `change` (n,) of the rates `before` (n,), as far as they allow it."""
    lower, upper = limits
    return np.clip(before - change, lower, upper), np.clip(before + change, lower, upper)


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
    finite at singular postures too.  Where limits and rows exclude each other, the limits hold, and the rows are
    exceeded by as little as possible in sum.  Solved by DAQP (Arnström et al. 2022) through qpsolvers;
    where it finds no solution, the rates are as near to 0 as the limits allow.
    """
    n, G = len(preferred), np.empty((0, len(preferred))) if rows is None else rows
    damping = np.broadcast_to(np.asarray(weights, dtype=float), preferred.shape) ** 2
    k, (lower, upper) = len(G), limits
    H, g = np.zeros((n + k, n + k)), np.full(n + k, _PRICE)
    H.ravel()[:: n + k + 1] = _SLACK_WEIGHT
    H[:n, :n] = J.T @ J + np.diag(damping)
    g[:n] = -J.T @ wanted - damping * preferred
    upper = np.maximum(lower, upper)
    least, largest = np.append(lower, np.zeros(k)), np.append(upper, np.full(k, np.inf))
    A, b = (np.hstack([G, -np.eye(k)]), np.asarray(most, dtype=float)) if k else (None, None)
    x = solve_qp(H, g, A, b, lb=least, ub=largest, solver="daqp", primal_tol=_TOLERANCE)
    rates = np.zeros(n) if x is None else x[:n]
    return np.clip(rates, lower, upper)
