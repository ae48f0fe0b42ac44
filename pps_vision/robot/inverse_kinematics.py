"""Inverse kinematics of many targets at once: damped least squares within joint limits.

The forward model is an argument, so a learned one serves as well as `Chain.positions`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Array, Mask

_MIN_DAMPING = 1e-10  # keeps JJᵀ invertible when joints at their limits are left out

ForwardModel = Callable[[Array], tuple[Array, Array]]
"""q (N, k) → x (N, m), ∂x/∂q (N, m, k)."""


@dataclass(frozen=True)
class IKParams:
    """Termination criteria and initial damping."""

    tolerance: float = 1e-6  # largest error of a solution, in units of x
    max_steps: int = 60  # steps per start
    min_step_rad: float = 1e-7  # stop at a shorter step
    initial_damping: float = 1e-4  # λ of the first step, in units of x² per rad²


@dataclass(frozen=True)
class IKSolution:
    """The best posture found for each of N targets."""

    q_rad: Array  # (N, k)
    error: Array  # (N,) remaining distance ‖target − x‖
    converged: Mask  # (N,) whether the error is within tolerance


def solve_ik(
    forward: ForwardModel,
    targets: ArrayLike,
    starts: ArrayLike,
    lower_rad: ArrayLike,
    upper_rad: ArrayLike,
    params: IKParams | None = None,
) -> IKSolution:
    """The posture within the limits whose x is nearest to each target, by Levenberg–Marquardt.

    ValueError for shapes that do not fit, or limits out of order.

    Args:
        forward: forward model.
        targets: (N, m).
        starts: (S, N, k); the first is tried for every target, the next only for those not reached yet.
        lower_rad: (k,) lower joint limits.
        upper_rad: (k,) upper joint limits.
        params: when to stop.
    """
    params = params or IKParams()
    targets, starts, lower, upper = (np.asarray(a, dtype=float) for a in (targets, starts, lower_rad, upper_rad))
    if targets.ndim != 2 or starts.ndim != 3 or starts.shape[1] != len(targets):
        raise ValueError(f"targets {targets.shape}, starts {starts.shape}: expected (N, m) and (S, N, k)")
    if lower.shape != starts.shape[2:] or upper.shape != lower.shape or not np.all(lower <= upper):
        raise ValueError(f"joint limits {lower}, {upper}: expected {starts.shape[2]} of each, lower below upper")
    best_q = starts[0].copy()
    best_error = np.full(len(targets), np.inf)
    for start in starts:
        todo = best_error > params.tolerance
        if not todo.any():
            break
        q, error = _descend(forward, targets[todo], start[todo].clip(lower, upper), lower, upper, params)
        better = error < best_error[todo]
        best_q[todo] = np.where(better[:, None], q, best_q[todo])
        best_error[todo] = np.where(better, error, best_error[todo])
    return IKSolution(best_q, best_error, best_error <= params.tolerance)


def _descend(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, params: IKParams
) -> tuple[Array, Array]:
    """Levenberg–Marquardt from one start each, one damping per problem; solved problems leave the batch."""
    x, J = forward(q)
    J = J.copy()
    residual: Array = targets - x
    error: Array = length(residual)
    damping = np.full_like(error, params.initial_damping)
    unsolved = np.flatnonzero(error > params.tolerance)
    for _ in range(params.max_steps):
        if len(unsolved) == 0:
            break
        q_old = q[unsolved]
        # joints that the gradient pushes beyond the limit they are at stay there
        gradient = np.einsum("nmk,nm->nk", J[unsolved], residual[unsolved])
        stuck = ((q_old <= lower) & (gradient < 0)) | ((q_old >= upper) & (gradient > 0))
        step = damped_step(J[unsolved] * ~stuck[:, None, :], residual[unsolved], damping[unsolved])
        q_new = (q_old + step).clip(lower, upper)
        x, J_new = forward(q_new)
        residual_new = targets[unsolved] - x
        error_new = length(residual_new)
        good = error_new < error[unsolved]
        better = unsolved[good]
        q[better] = q_new[good]
        residual[better] = residual_new[good]
        J[better] = J_new[good]
        error[better] = error_new[good]
        scaled = damping[unsolved]
        damping[unsolved] = np.where(good, np.maximum(scaled * 0.1, _MIN_DAMPING), scaled * 10)
        moved = np.any(np.abs(q_new - q_old) > params.min_step_rad, axis=1)
        unsolved = unsolved[(error[unsolved] > params.tolerance) & moved]
    return q, error


def damped_step(J: Array, residual: Array, damping: Array | float) -> Array:
    """Jᵀ(JJᵀ + λI)⁻¹ r, (N, k) of J (N, m, k), r (N, m) and λ (N,)."""
    J_T = np.swapaxes(J, 1, 2)
    A = J @ J_T + np.asarray(damping)[..., None, None] * np.eye(J.shape[1])
    return np.asarray((J_T @ np.linalg.solve(A, residual[..., None]))[..., 0])


def length(vectors: Array) -> Array:
    """(N,) of vectors (N, m)."""
    return np.asarray(np.sqrt(np.einsum("nm,nm->n", vectors, vectors)))
