"""Joint rates for a task velocity: damped least squares within joint-rate limits."""

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.jit import njit
from pps_vision.types import Array

_PATIENCE = 3  # exchanges of all that is wrong without progress before only one is exchanged
_MAX_EXCHANGES = 500  # nearly all problems need 2 or 3


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


def solve_rates(J: Array, wanted: Array, preferred: Array, weights: ArrayLike, limits: tuple[Array, Array]) -> Array:
    """The rates x (n,) within `limits` that minimise ‖J x − wanted‖² + ‖weights·(x − preferred)‖².

    J is (m, n), wanted (m,), preferred (n,); positive weights make the solution unique and finite at singular postures
    too.
    """
    damping = np.broadcast_to(np.asarray(weights, dtype=float), preferred.shape) ** 2
    H = J.T @ J
    H[np.diag_indices_from(H)] += damping
    lower, upper = limits
    x, found = _bounded_minimum(H, J.T @ wanted + damping * preferred, lower, np.maximum(lower, upper))
    if not found:
        raise RuntimeError(f"no rates in {_MAX_EXCHANGES} exchanges for J {J.tolist()}, limits {limits}")
    return x


@njit(cache=True, error_model="numpy")
def _bounded_minimum(H: Array, g: Array, lower: Array, upper: Array) -> tuple[Array, bool]:
    """The x (n,) within limits that minimises ½ xᵀ H x − gᵀ x for a positive definite H, and whether it was found.

    By block principal pivoting (Júdice and Pires 1994): take some of x to be at their limits, solve for the others by
    Cholesky's method, and exchange those that contradict the conditions of optimality, until none does.  Exchanged
    are all of them, or, where this has not made them fewer for a while, the last one, which is certain to end.
    """
    n = len(g)
    at, x, L = np.zeros(n, np.int64), np.zeros(n), np.zeros((n, n))  # at: −1 lower limit, 0 free, 1 upper limit
    fewest, patience = n + 1, _PATIENCE
    for _ in range(_MAX_EXCHANGES):
        for i in range(n):
            x[i] = g[i] if at[i] == 0 else lower[i] if at[i] < 0 else upper[i]
            for j in range(i + 1):
                L[i, j] = H[i, j] if at[i] == 0 and at[j] == 0 else (1.0 if i == j else 0.0)
        for i in range(n):
            for j in range(n):
                if at[i] == 0 and at[j] != 0:
                    x[i] -= H[i, j] * (lower[j] if at[j] < 0 else upper[j])
            for j in range(i + 1):
                for k in range(j):
                    L[i, j] -= L[i, k] * L[j, k]
                L[i, j] = np.sqrt(L[i, i]) if i == j else L[i, j] / L[j, j]
        for i in range(n):
            for k in range(i):
                x[i] -= L[i, k] * x[k]
            x[i] /= L[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                x[i] -= L[k, i] * x[k]
            x[i] /= L[i, i]
        wrong, last, new = 0, 0, at.copy()
        for i in range(n):
            if at[i] == 0:
                new[i] = -1 if x[i] < lower[i] else 1 if x[i] > upper[i] else 0
            else:
                gradient = -g[i]
                for j in range(n):
                    gradient += H[i, j] * x[j]
                new[i] = 0 if at[i] * gradient > 0 else at[i]
            if new[i] != at[i]:
                wrong, last = wrong + 1, i
        if wrong == 0:
            return x, True
        patience = _PATIENCE if wrong < fewest else patience - 1
        fewest = min(fewest, wrong)
        if patience > 0:
            at = new
        else:
            at[last] = new[last]
    return x, False
