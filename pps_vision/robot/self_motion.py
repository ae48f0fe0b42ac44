"""Along the postures that keep the hand where it is: which of them is best, by any measure (J, second stage of IK).

An arm with one joint more than the task asks for can move without its hand, along a curve that closes upon itself.
It is walked all around from a posture that reaches the target, beyond the joints' limits too, since what lies within
them may be several stretches; only there a posture counts.  Other curves (a shoulder turned over) need other starts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from array_api_compat import array_namespace

from pps_vision.robot.inverse_kinematics import ForwardModel, damped, length
from pps_vision.types import Array, Mask

Measure = Callable[[Array, Array], Array]  # q (N, k), ∂x/∂q (N, m, k) -> how good a posture is (N,), 1 at best


@dataclass(frozen=True)
class WalkParams:
    """`step_rad` along the curve and how many of them each way; how far off its place (m) the hand may be; the best
    posture's surroundings are searched again in steps `finer` times as small."""

    step_rad: float = 0.3
    steps: int = 16
    tolerance: float = 1e-4
    finer: int = 8


def walk(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, measure: Measure, params: WalkParams
) -> tuple[Array, Array]:
    """The best posture (N, k) within the limits on the curve through each `q` (N, k), which reaches its target (N, m),
    and how good it is (N,).  Arrays are NumPy's or torch's."""
    xp = array_namespace(q)
    best_q, best = q, measure(q, forward(q)[1])
    for step, n in ((params.step_rad, params.steps), (params.step_rad / params.finer, params.finer)):
        for here, J, there in _visited(forward, targets, best_q, lower, upper, step, n, params.tolerance):
            value = xp.where(there, measure(here, J), -xp.inf)
            better = value > best
            best_q, best = xp.where(better[:, None], here, best_q), xp.where(better, value, best)
    return best_q, best


def approaches(
    forward: ForwardModel,
    normals: Callable[[Array], Array],
    targets: Array,
    q: Array,
    lower: Array,
    upper: Array,
    approach: "Approach",
    params: WalkParams,
) -> Mask:
    """(N, n) which directions the hand's normal takes somewhere on the curve through each `q` (N, k), which reaches its
    target, within the limits; `normals` q (N, k) → unit normals (N, 3)."""
    near, directions = np.cos(approach.within_rad), approach.directions
    met: Mask = normals(q) @ directions.T >= near
    for here, _, there in _visited(forward, targets, q, lower, upper, params.step_rad, params.steps, params.tolerance):
        met |= there[:, None] & (normals(here) @ directions.T >= near)
    return met


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
    """Both ways from `begin` (N, k) along the curve, `n` steps each: postures, their Jacobians, and which of them
    reach the target within the limits."""
    xp = array_namespace(begin)
    for way in (-1.0, 1.0):
        here, heading = begin, way * xp.ones_like(begin)
        J = forward(here)[1]
        for _ in range(n):
            heading = _along(J, heading)
            here, J, there = _stride(forward, targets, here + step * heading, tolerance)
            yield here, J, there & xp.all((here >= lower) & (here <= upper), axis=1)


def _along(J: Array, heading: Array) -> Array:
    """The unit direction (N, k) nearest to a heading that moves the joints and not the hand."""
    xp = array_namespace(J)
    free = heading - damped(J, (J @ heading[..., None])[..., 0], xp.full_like(J[:, 0, 0], 1e-9))
    unit: Array = free / xp.clip(length(free), 1e-12, None)[:, None]
    return unit


def _stride(forward: ForwardModel, targets: Array, q: Array, tolerance: float) -> tuple[Array, Array, Mask]:
    """The posture with the hand brought back to its target, its Jacobian before that, and whether it is there."""
    xp = array_namespace(q)
    for _ in range(2):
        x, J = forward(q)
        q = q + damped(J, targets - x, xp.full_like(x[:, 0], 1e-9))
    x, J = forward(q)
    return q, J, length(targets - x) <= tolerance


@dataclass(frozen=True)
class FarFromLimits:
    """1 − M of J IV.5: M the mean squared distance of the joints from the middle of their ranges, of half a range."""

    lower_rad: Array
    upper_rad: Array

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of postures (N, k)."""
        xp = array_namespace(q)
        lower, upper = (xp.asarray(a, dtype=q.dtype, device=q.device) for a in (self.lower_rad, self.upper_rad))
        half = (upper - lower) / 2
        return 1 - (((q - (upper + lower) / 2) / xp.where(half > 0, half, 1)) ** 2).mean(-1)


@dataclass(frozen=True)
class Manipulability:
    """Yoshikawa's √det(JJᵀ): how large a volume of hand velocities unit joint rates span, of `most` (m³ for a
    position).  With `isotropy` the least singular value of J over the largest instead: 0 at a singular posture, 1
    where the hand moves equally well in all directions."""

    most: float = 1.0
    isotropy: bool = False

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of Jacobians (N, m, k)."""
        xp = array_namespace(J)
        values = xp.linalg.svdvals(J)
        ratio: Array = values[:, -1] / values[:, 0] if self.isotropy else xp.prod(values, axis=1) / self.most
        return ratio


@dataclass(frozen=True)
class Approach:
    """From how many sides the hand can come to a place, as Zacharias' capability map has it, the wrist kept still: the
    share of `n` directions, spread evenly over the sphere, that its normal can take within `within_rad`, over all
    postures that reach the place.  Not of one posture, so no `Measure`."""

    n: int = 200
    within_rad: float = np.deg2rad(20)

    @property
    def directions(self) -> Array:
        """(n, 3) on a spiral of equal areas."""
        z = 1 - (2 * np.arange(self.n) + 1) / self.n
        turn = np.pi * (1 + 5**0.5) * np.arange(self.n)
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
