"""Inverse kinematics of many targets at once: damped least squares within joint limits.

The forward model is an argument, so a learned one serves as well as `Chain.positions`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
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
    targets: ArrayLike,
    starts: ArrayLike,
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
    targets, starts = np.asarray(targets, dtype=float), np.asarray(starts, dtype=float)
    lower, upper = np.asarray(lower_rad, dtype=float), np.asarray(upper_rad, dtype=float)
    if targets.ndim != 2 or starts.ndim != 3 or starts.shape[1] != len(targets):
        raise ValueError(f"targets {targets.shape}, starts {starts.shape}: expected (N, m) and (S, N, k)")
    if lower.shape != starts.shape[2:] or upper.shape != lower.shape or not np.all(lower <= upper):
        raise ValueError(f"joint limits {lower}, {upper}: expected {starts.shape[2]} of each, lower below upper")
    best_q, best_error = np.array(starts[0]), np.full(len(targets), np.inf)
    for start in starts:
        todo = np.flatnonzero(best_error > params.tolerance)
        if todo.size == 0:
            break
        q, error = _descend(forward, targets[todo], np.clip(start[todo], lower, upper), lower, upper, params)
        better = error < best_error[todo]
        best_q[todo[better]], best_error[todo[better]] = q[better], error[better]
    return IKSolution(best_q, best_error, best_error <= params.tolerance)


def _descend(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, params: IKParams
) -> tuple[Array, Array]:
    """Levenberg–Marquardt from one start each; problems that are done leave the batch."""
    x, J = forward(q)
    residual = targets - x
    out_q, out_error = q.copy(), np.linalg.norm(residual, axis=1)
    damping = np.full(len(q), params.first_damping)
    left = np.flatnonzero(out_error > params.tolerance)
    q, residual, J, damping = q[left], residual[left], J[left], damping[left]
    for _ in range(params.max_steps):
        if left.size == 0:
            break
        q_new = np.clip(q + _step(q, residual, J, damping, lower, upper), lower, upper)
        x, J_new = forward(q_new)
        residual_new = targets[left] - x
        error, error_new = np.linalg.norm(residual, axis=1), np.linalg.norm(residual_new, axis=1)
        moved = np.abs(q_new - q).max(axis=1)
        good = error_new < error
        q, residual, J = np.where(good[:, None], q_new, q), residual.copy(), J.copy()
        residual[good], J[good] = residual_new[good], J_new[good]
        damping = np.where(good, np.maximum(damping * 0.1, _LEAST_DAMPING), damping * 10)
        error = np.where(good, error_new, error)
        out_q[left], out_error[left] = q, error
        more = (error > params.tolerance) & (moved > params.min_step_rad)
        left, q, residual, J, damping = left[more], q[more], residual[more], J[more], damping[more]
    return out_q, out_error


def _step(q: Array, residual: Array, J: Array, damping: Array, lower: Array, upper: Array) -> Array:
    """Jᵀ(JJᵀ + λI)⁻¹ r over the joints that are free to move.

    A joint may be pushed beyond its limit by the step though not by the gradient; so those
    that the first solution would push out are left out of a second one.
    """
    gradient = np.einsum("nmk,nm->nk", J, residual)
    at_lower, at_upper = q <= lower, q >= upper
    stuck = (at_lower & (gradient < 0)) | (at_upper & (gradient > 0))
    dq = _damped(np.where(stuck[:, None], 0.0, J), residual, damping)
    stuck |= (at_lower & (dq < 0)) | (at_upper & (dq > 0))
    return _damped(np.where(stuck[:, None], 0.0, J), residual, damping)


def _damped(J: Array, residual: Array, damping: Array) -> Array:
    A = J @ np.swapaxes(J, 1, 2) + damping[:, None, None] * np.eye(J.shape[1])
    dq: Array = (np.swapaxes(J, 1, 2) @ np.linalg.solve(A, residual[..., None]))[..., 0]
    return dq
