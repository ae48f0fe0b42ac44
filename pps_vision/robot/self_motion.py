"""Second stage of inverse kinematics: the best of the postures that keep the hand where it is, by any measure (J).

An arm with one joint more than the task asks for moves without its hand along a closed curve, its self-motion
manifold.  It is followed all around from a posture that reaches the target, beyond the joints' limits too, since what
lies within them may be several stretches; only there a posture counts.  Other curves (a shoulder turned over) need
other starts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pps_vision.robot.inverse_kinematics import ForwardModel, damped_step, length
from pps_vision.types import Array, Mask

_DAMPING = 1e-9  # of the steps along the curve and back to the target; keeps JJᵀ invertible

Measure = Callable[[Array, Array], Array]
"""q (N, k), ∂x/∂q (N, m, k) → quality of a posture (N,), 1 at best."""


@dataclass(frozen=True)
class WalkParams:
    """How the self-motion manifold is sampled."""

    step_rad: float = 0.3
    """Length of a step along the curve."""
    steps: int = 16
    """Steps in each direction."""
    tolerance: float = 1e-4
    """Distance of the hand from its target that counts as reached, in units of x."""
    finer: int = 8
    """The surroundings of the best posture are searched again in steps this many times smaller."""


def walk(
    forward: ForwardModel, targets: Array, q: Array, lower: Array, upper: Array, measure: Measure, params: WalkParams
) -> tuple[Array, Array]:
    """The best posture (N, k) within the limits on the curve through each `q` (N, k), and its quality (N,).

    `targets` (N, m) are what the postures `q` reach; limits (k,) rad.
    """
    best_q, best = q, measure(q, forward(q)[1])
    for step, n in ((params.step_rad, params.steps), (params.step_rad / params.finer, params.finer)):
        for here, J, valid in _visited(forward, targets, best_q, lower, upper, step, n, params.tolerance):
            quality = np.where(valid, measure(here, J), -np.inf)
            better = quality > best
            best_q, best = np.where(better[:, None], here, best_q), np.where(better, quality, best)
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
    """(N, n) which directions the hand's normal takes within the limits on the curve through each `q` (N, k).

    `targets` (N, m) are what the postures `q` reach; `normals` q (N, k) → unit normals (N, 3); limits (k,) rad.
    """
    min_cosine, directions = np.cos(coverage.within_rad), coverage.directions
    met: Mask = normals(q) @ directions.T >= min_cosine
    for here, _, valid in _visited(forward, targets, q, lower, upper, params.step_rad, params.steps, params.tolerance):
        met |= valid[:, None] & (normals(here) @ directions.T >= min_cosine)
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
    """Both ways from `begin` (N, k) along the curve, `n` steps each.

    Yields postures, their Jacobians, and which of them reach the target within the limits.
    """
    for way in (-1.0, 1.0):
        here, heading = begin, np.full_like(begin, way)
        J = forward(here)[1]
        for _ in range(n):
            # the unit direction nearest to the heading in the null space of J
            heading = heading - damped_step(J, (J @ heading[..., None])[..., 0], _DAMPING)
            heading = heading / np.maximum(length(heading), 1e-12)[:, None]
            here = here + step * heading
            for _ in range(2):  # Newton steps that bring the hand back to its target
                x, J = forward(here)
                here = here + damped_step(J, targets - x, _DAMPING)
            x, J = forward(here)
            within = np.all((here >= lower) & (here <= upper), axis=1)
            yield here, J, within & (length(targets - x) <= tolerance)


@dataclass(frozen=True)
class FarFromLimits:
    """1 − M of J IV.5: M the mean squared distance of the joints from the middle of their ranges, of half a range."""

    lower_rad: Array
    """(k,) lower joint limits."""
    upper_rad: Array
    """(k,) upper joint limits."""

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of postures (N, k)."""
        half = (self.upper_rad - self.lower_rad) / 2
        away = (q - (self.upper_rad + self.lower_rad) / 2) / np.where(half > 0, half, 1)
        quality: Array = 1 - np.mean(away**2, axis=-1)
        return quality


@dataclass(frozen=True)
class Manipulability:
    """Yoshikawa's manipulability √det(JJᵀ), or the isotropy of the Jacobian."""

    largest: float = 1.0
    """Manipulability that counts as 1 (m³ for a position)."""
    isotropy: bool = False
    """Instead of the manipulability, the smallest singular value of J over the largest: 0 at a singular posture."""

    def __call__(self, q: Array, J: Array) -> Array:
        """(N,) of Jacobians (N, m, k)."""
        values = np.linalg.svdvals(J)
        ratio: Array = values[:, -1] / values[:, 0] if self.isotropy else np.prod(values, axis=1) / self.largest
        return ratio


@dataclass(frozen=True)
class DirectionCoverage:
    """Share of directions from which the hand can come to a place, the wrist kept still (Zacharias' capability map).

    Over all postures that reach the place; so it is no `Measure` of one posture.
    """

    n: int = 200
    """Directions, spread evenly over the sphere."""
    within_rad: float = np.deg2rad(20)
    """Angle between a direction and the hand's normal that counts as taking it."""

    @property
    def directions(self) -> Array:
        """(n, 3) on a spiral of equal areas."""
        z = 1 - (2 * np.arange(self.n) + 1) / self.n
        turn = np.pi * (1 + 5**0.5) * np.arange(self.n)
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
