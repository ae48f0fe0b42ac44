"""Joint rates for a task velocity: damped least squares within joint-rate limits."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import lsq_linear

from pps_vision.types import Array

_MAX_ITERATIONS = 200  # SciPy's default, one for each joint, is too few for 3 of 1000 problems


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
    damping = np.broadcast_to(np.asarray(weights, dtype=float), preferred.shape)
    A = np.vstack([J, np.diag(damping)])
    b = np.concatenate([wanted, damping * preferred])
    lower, upper = limits
    upper = np.maximum(upper, lower + 1e-9)  # the solver needs lower < upper
    found = lsq_linear(A, b, (lower, upper), method="bvls", max_iter=_MAX_ITERATIONS)
    if not found.success:
        raise RuntimeError(f"no rates in {_MAX_ITERATIONS} iterations for J {J.tolist()}, limits {limits}")
    return np.asarray(found.x)
