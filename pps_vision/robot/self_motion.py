"""Inverse kinematics in two stages (J): reach the target, then find the best posture on its self-motion manifold.

An arm with one joint more than the task needs can move along a closed curve, its self-motion manifold, while the hand
stays in place.  The curve is followed all around from a posture that reaches the target, also beyond the joint limits,
since the part within them may be disconnected; only postures within the limits count.  Other curves (a shoulder turned
over) need other starts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pps_vision.robot.inverse_kinematics import ForwardModel, IKParams, IKSolution, damped_step, length, solve_ik
from pps_vision.types import Array, Mask

_DAMPING = 1e-9  # keeps JJᵀ invertible in all steps

Measure = Callable[[Array, Array], Array]
"""q (N, k), ∂x/∂q (N, m, k) → quality of a posture (N,), 1 at best."""


@dataclass(frozen=True)
class WalkParams:
    """Sampling of the self-motion manifold."""

    step_rad: float = 0.3  # length of a step along the curve
    steps: int = 16  # steps in each direction
    tolerance: float = 1e-4  # largest distance of the hand from its target, in units of x
    finer: int = 8  # factor by which the steps of the second search, around the best posture, are smaller


def walk(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, measure: Measure, params: WalkParams
) -> tuple[Array, Array]:
    """The best posture (N, k) within the limits on the curve through each `q` (N, k), and its quality (N,).

    `targets` (N, m) are the positions of the postures `q`; limits (k,) rad.
    """
    best_q = q
    best = measure(q, forward(q)[1])
    for step, n in ((params.step_rad, params.steps), (params.step_rad / params.finer, params.finer)):
        for posture, J, valid in _visited(forward, targets, best_q, lower, upper, step, n, params.tolerance):
            quality = np.where(valid, measure(posture, J), -np.inf)
            better = quality > best
            best_q = np.where(better[:, None], posture, best_q)
            best = np.where(better, quality, best)
    return best_q, best


def covered_directions(
    forward: ForwardModel,
    normals: Callable[[Array], Array],
    targets: Array,
    q: Array,
    lower: Array,
    upper: Array,
    coverage: "DirectionCoverage",
    params: WalkParams,
) -> Mask:
    """(N, n) directions that the hand's normal takes within the limits on the curve through each `q` (N, k).

    `targets` (N, m) are the positions of the postures `q`; `normals` q (N, k) → unit normals (N, 3); limits (k,) rad.
    """
    directions = coverage.directions
    min_cosine = np.cos(coverage.within_rad)
    covered: Mask = normals(q) @ directions.T >= min_cosine
    for posture, _, valid in _visited(
        forward, targets, q, lower, upper, params.step_rad, params.steps, params.tolerance
    ):
        covered |= valid[:, None] & (normals(posture) @ directions.T >= min_cosine)
    return covered


def _visited(
    forward: ForwardModel,
    targets: Array,
    begin: Array,
    lower: Array,
    upper: Array,
    step: float,
    n: int,
    tolerance: float,
) -> Iterator[tuple[Array, Array, Mask]]:
    """Both ways from `begin` (N, k) along the curve, `n` steps each.

    Yields postures, their Jacobians, and which of them reach the target within the limits.
    """
    for way in (-1.0, 1.0):
        q = begin
        heading = np.full_like(begin, way)
        J = forward(q)[1]
        for _ in range(n):
            # the unit direction nearest to the heading in the null space of J
            heading = heading - damped_step(J, (J @ heading[..., None])[..., 0], _DAMPING)
            heading = heading / np.maximum(length(heading), 1e-12)[:, None]
            q = q + step * heading
            for _ in range(2):  # Newton steps that bring the hand back to its target
                x, J = forward(q)
                q = q + damped_step(J, targets - x, _DAMPING)
            x, J = forward(q)
            within = np.all((q >= lower) & (q <= upper), axis=1)
            yield q, J, within & (length(targets - x) <= tolerance)


@dataclass(frozen=True)
class FarFromLimits:
    """1 − M of J IV.5: M the mean squared distance of the joints from the middle of their ranges, of half a range."""

    lower_rad: Array  # (k,) lower joint limits
    upper_rad: Array  # (k,) upper joint limits

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of postures (N, k)."""
        half = (self.upper_rad - self.lower_rad) / 2
        away = (q - (self.upper_rad + self.lower_rad) / 2) / np.where(half > 0, half, 1)
        return np.asarray(1 - np.mean(away**2, axis=-1))


@dataclass(frozen=True)
class Manipulability:
    """Yoshikawa's manipulability √det(JJᵀ), or the isotropy of the Jacobian."""

    largest: float = 1.0  # manipulability that counts as 1 (m³ for a position)
    isotropy: bool = False  # use the smallest singular value of J over the largest instead: 0 at a singular posture

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of Jacobians (N, m, k)."""
        values = np.linalg.svdvals(J)
        return np.asarray(values[:, -1] / values[:, 0] if self.isotropy else np.prod(values, axis=1) / self.largest)


@dataclass(frozen=True)
class DirectionCoverage:
    """Share of directions from which the hand can approach a place, with a fixed wrist (Zacharias' capability map).

    Over all postures that reach the place, so it is no `Measure` of one posture.
    """

    n: int = 200  # directions, spread evenly over the sphere
    within_rad: float = np.deg2rad(20)  # largest angle between a covered direction and the hand's normal

    @property
    def directions(self) -> Array:
        """(n, 3) on a spiral of equal areas."""
        z = 1 - (2 * np.arange(self.n) + 1) / self.n
        turn = np.pi * (1 + 5**0.5) * np.arange(self.n)
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


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


def best_of_starts(
    reach: Callable[[Array, Array], IKSolution],
    improve: Callable[[Array, Array], tuple[Array, Array]],
    targets: Array,
    starts: Array,
) -> TwoStage:
    """Run both stages from every start (S, N, k) and keep the best posture of each target (N, m).

    `reach`: targets (N, m), starts (N, k) → postures near the targets; `improve`: targets, postures that reach them →
    the best postures (N, k), their quality (N,).
    """
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
