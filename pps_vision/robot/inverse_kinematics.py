"""Inverse kinematics of many targets at once: damped least squares within joint limits.

The forward model is an argument, so a learned one serves as well as `Chain.positions`.  Arrays are NumPy's or
torch's, on any device: what goes in comes out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_array
from numpy.typing import ArrayLike

from pps_vision.types import Array, Mask

_LEAST_DAMPING = 1e-10  # keeps JJᵀ invertible when joints at their limits are left out

ForwardModel = Callable[[Array], tuple[Array, Array]]  # q (N, k) -> x (N, m), ∂x/∂q (N, m, k)


@dataclass(frozen=True)
class IKParams:
    """When to stop: `tolerance` is the error (in units of x) that counts as reached; a problem is
    given up after `max_steps`, or once its step is shorter than `min_step_rad`."""

    tolerance: float = 1e-6
    max_steps: int = 60
    min_step_rad: float = 1e-7
    first_damping: float = 1e-4


@dataclass(frozen=True)
class IKSolution:
    """Postures `q_rad` (N, k), what is left of the error (N,), and whether it is within tolerance (N,)."""

    q_rad: Array
    error: Array
    converged: Mask


def solve_ik(
    forward: ForwardModel,
    targets: Any,
    starts: Any,
    lower_rad: ArrayLike,
    upper_rad: ArrayLike,
    params: IKParams | None = None,
) -> IKSolution:
    """The posture within the limits whose x comes nearest to each target.

    `targets` (N, m); `starts` (S, N, k): the first is tried for every target, the next only for
    those not reached yet; the best is returned.  Levenberg–Marquardt with one damping a target;
    a joint that is at its limit and pushed beyond it is left out of the step.
    """
    params = params or IKParams()
    targets, starts = _float(targets), _float(starts)
    xp = array_namespace(targets)
    lower, upper = (xp.asarray(limit, dtype=targets.dtype, device=targets.device) for limit in (lower_rad, upper_rad))
    if targets.ndim != 2 or starts.ndim != 3 or starts.shape[1] != len(targets):
        raise ValueError(f"targets {targets.shape}, starts {starts.shape}: expected (N, m) and (S, N, k)")
    if lower.shape != starts.shape[2:] or upper.shape != lower.shape or not xp.all(lower <= upper):
        raise ValueError(f"joint limits {lower}, {upper}: expected {starts.shape[2]} of each, lower below upper")
    best_q, best_error = xp.asarray(starts[0], copy=True), xp.full_like(targets[:, 0], xp.inf)
    for start in starts:
        todo = best_error > params.tolerance
        if not xp.any(todo):
            break
        q, error = _descend(forward, targets[todo], xp.clip(start[todo], lower, upper), lower, upper, params)
        better = error < best_error[todo]
        best_q[todo] = xp.where(better[:, None], q, best_q[todo])
        best_error[todo] = xp.where(better, error, best_error[todo])
    return IKSolution(best_q, best_error, best_error <= params.tolerance)


def _float(values: Any) -> Any:
    return values if is_torch_array(values) else np.asarray(values, dtype=float)


def _descend(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, params: IKParams
) -> tuple[Array, Array]:
    """Levenberg–Marquardt from one start each; problems that are done leave the batch."""
    xp = array_namespace(q)
    x, J = forward(q)
    residual = targets - x
    error = length(residual)
    out_q, out_error = xp.asarray(q, copy=True), xp.asarray(error, copy=True)
    damping = xp.full_like(error, params.first_damping)
    left = xp.nonzero(error > params.tolerance)[0]
    q, residual, J, error, damping = q[left], residual[left], J[left], error[left], damping[left]
    for _ in range(params.max_steps):
        if len(left) == 0:
            break
        q_new = xp.clip(q + _step(q, residual, J, damping, lower, upper), lower, upper)
        x, J_new = forward(q_new)
        residual_new = targets[left] - x
        error_new = length(residual_new)
        moved = xp.any(abs(q_new - q) > params.min_step_rad, axis=1)
        good = error_new < error
        q = xp.where(good[:, None], q_new, q)
        residual = xp.where(good[:, None], residual_new, residual)
        J = xp.where(good[:, None, None], J_new, J)
        error = xp.where(good, error_new, error)
        damping = xp.where(good, xp.clip(damping * 0.1, _LEAST_DAMPING, None), damping * 10)
        out_q[left], out_error[left] = q, error
        more = (error > params.tolerance) & moved
        left, q, residual, J, error, damping = (a[more] for a in (left, q, residual, J, error, damping))
    return out_q, out_error


def length(vectors: Array) -> Array:
    """(N,) of vectors (N, m)."""
    norm: Array = (vectors * vectors).sum(-1) ** 0.5
    return norm


def _step(q: Array, residual: Array, J: Array, damping: Array, lower: Array, upper: Array) -> Array:
    """Jᵀ(JJᵀ + λI)⁻¹ r without the joints that the gradient pushes beyond the limit they are at."""
    gradient = (J * residual[..., None]).sum(-2)
    stuck = ((q <= lower) & (gradient < 0)) | ((q >= upper) & (gradient > 0))
    return damped(J * ~stuck[:, None, :], residual, damping)


def damped(J: Array, residual: Array, damping: Array) -> Array:
    """Jᵀ(JJᵀ + λI)⁻¹ r: (N, k) of J (N, m, k), r (N, m) and λ (N,)."""
    xp = array_namespace(J)
    A = J @ xp.matrix_transpose(J) + damping[:, None, None] * xp.eye(J.shape[1], dtype=J.dtype, device=J.device)
    dq: Array = (xp.matrix_transpose(J) @ xp.linalg.solve(A, residual[..., None]))[..., 0]
    return dq
