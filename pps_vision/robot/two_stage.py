"""Inverse kinematics in two stages (J): reach the target, then find the best posture that reaches it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pps_vision.robot.inverse_kinematics import ForwardModel, IKParams, IKSolution, solve_ik
from pps_vision.robot.self_motion import Measure, WalkParams, walk
from pps_vision.types import Array, Mask

ReachStage = Callable[[Array, Array], IKSolution]
"""Targets (N, m), starts (N, k) → postures near the targets."""
ImproveStage = Callable[[Array, Array], tuple[Array, Array]]
"""Targets (N, m), postures (N, k) that reach them → the best postures (N, k), their quality (N,)."""


@dataclass(frozen=True)
class TwoStageParams:
    """Both stages of inverse kinematics."""

    reach: IKParams = IKParams(tolerance=1e-4, max_steps=100, min_step_rad=3e-4)
    """First stage; its tolerance (m) is J's ε."""
    improve: WalkParams = field(default_factory=WalkParams)  # second stage


@dataclass(frozen=True)
class TwoStage:
    """The best posture for each of N targets."""

    q_rad: Array  # (N, k)
    error: Array  # (N,) smallest distance between hand and target, m
    reachable: Mask  # (N,) whether a posture reaches the target
    quality: Array  # (N,) quality of the best posture, NaN out of reach


def two_stage(
    forward: ForwardModel,
    targets: Array,
    starts: Array,
    lower_rad: Array,
    upper_rad: Array,
    measure: Measure,
    params: TwoStageParams | None = None,
) -> TwoStage:
    """Solve both stages as one batch.

    `targets` (N, m); all `starts` (S, N, k) are tried; limits (k,).  ValueError for shapes that do not fit.
    """
    params = params or TwoStageParams()
    return best_of_starts(
        lambda points, start: solve_ik(forward, points, start[None], lower_rad, upper_rad, params.reach),
        lambda points, q: walk(forward, points, q, lower_rad, upper_rad, measure, params.improve),
        targets,
        starts,
    )


def best_of_starts(reach: ReachStage, improve: ImproveStage, targets: Array, starts: Array) -> TwoStage:
    """Run both stages from every start (S, N, k) and keep the best posture of each target (N, m)."""
    best_q = starts[0].copy()
    best_error = np.full(len(targets), np.inf)
    best = np.full(len(targets), -np.inf)
    for start in starts:
        first = reach(targets, start)
        nearer = (first.error < best_error) & (best == -np.inf)
        best_q = np.where(nearer[:, None], first.q_rad, best_q)
        best_error = np.minimum(first.error, best_error)
        reached = np.flatnonzero(first.converged)
        if len(reached):
            q, quality = improve(targets[reached], first.q_rad[reached])
            better = quality > best[reached]
            best_q[reached] = np.where(better[:, None], q, best_q[reached])
            best[reached] = np.where(better, quality, best[reached])
    reachable = best > -np.inf
    return TwoStage(best_q, best_error, reachable, np.where(reachable, best, np.nan))
