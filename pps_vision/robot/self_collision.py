"""Self-collision distance: how far apart the two arms and the trunk are, by coal through Pinocchio."""

from itertools import combinations
from math import sqrt

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_SHORTEST_STEP = 1 / 512  # of a motion; a shorter one is not checked
_MOST_STEPS = 10  # bounds the time of a check
_ACCURACY_M = 1e-5  # a distance must exceed the smallest allowed one by so much; coal repeats itself within 1e-6 m
_NO_MOTION_M = 1e-12  # bodies that move by less are taken to rest


class SelfCollision:
    """Measures the distances between the bodies of the left arm, the right arm and the trunk.

    Bodies of one limb are not compared, nor adjacent ones: a body and the next body towards the root (upper arm and
    chest) touch by construction.
    """

    def __init__(self, robot: Robot, ignored: tuple[str, ...] = ()) -> None:
        """Of `robot.bodies` but for those named in `ignored`."""
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry = robot.geometry.copy()
        self._geometry.removeAllCollisionPairs()
        bodies = [(i, body) for i, body in enumerate(robot.geometry.geometryObjects) if body.name not in ignored]
        bodied = {body.parentJoint for _, body in bodies}
        arms = [{i + 1 for i in robot.indices(robot.names.arm(side))} for side in ("left", "right")]

        def limb(joint: int) -> list[bool]:
            return [not arm.isdisjoint(robot.model.supports[joint]) for arm in arms]

        def carrier(joint: int) -> int:
            """The next joint towards the root that has bodies, or the root."""
            return max((j for j in robot.model.supports[joint] if j in bodied and j != joint), default=0)

        for (i, one), (j, other) in combinations(bodies, 2):
            a, b = one.parentJoint, other.parentJoint
            if limb(a) != limb(b) and carrier(max(a, b)) != min(a, b):  # Pinocchio numbers parents before children
                self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._distances = pin.GeometryData(self._geometry)
        self._lever_m = _levers(robot.model, [body for _, body in bodies])

    @property
    def moving(self) -> Mask:
        """(n_joints,) whether a joint moves a body."""
        return self._lever_m > 0

    def distance_m(self, q_rad: ArrayLike) -> float:
        """The smallest distance at a configuration (n_joints,); negative where bodies overlap."""
        q = np.asarray(q_rad, dtype=float)
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._distances, q)
        return float(self._distances.distanceResults[nearest].min_distance)

    def clear_share(self, q_rad: Array, change_rad: Array, clearance_m: float) -> float:
        """The share in [0, 1] of a straight motion along which the distance provably stays at `clearance_m` or more.

        From a start that is nearer already: along which the distance does not fall below that of the start; 0 where
        bodies overlap.  The motion leads from `q_rad` to `q_rad + change_rad` (n_joints,).

        Let d₀, d₁ be the distances at the ends of a step and m the smallest within.  The nearest points of that
        instant move at right angles to their connection, relatively by at most v and with an acceleration of at most κ
        (a step of length h of the whole motion): d² ≤ m² + w² x² at x from it, w² = v² + κ (m + v h + κ h²/4).  So
        m² ≥ d₀² − w² x² at the x where the bounds from both ends meet, or m is d₀ or d₁.
        """
        turn = np.abs(change_rad) * self.moving
        v = float(turn @ self._lever_m)
        if v <= _NO_MOTION_M:
            return 1.0
        kappa = float(turn.sum()) * v
        shortest = max(_SHORTEST_STEP, 50 * _ACCURACY_M / v)
        d0 = self.distance_m(q_rad)
        least, done, longest = min(clearance_m, d0), 0.0, 1.0
        if d0 <= 0.0:
            return 0.0
        for _ in range(_MOST_STEPS):
            to_graze = 2 * sqrt(d0**2 - least**2) / v  # a step after which the same distance again would do
            h = min(max(to_graze, shortest), longest, 1.0 - done)
            d1 = self.distance_m(q_rad + (done + h) * change_rad)
            if d1 >= least + _ACCURACY_M and _smallest_squared(d0, d1, h, v, kappa) >= least**2:
                done, d0, longest = done + h, d1, 1.0
                if done >= 1.0:
                    return 1.0
            elif h <= shortest:
                break
            else:
                longest = 0.5 * h
        return done


def _smallest_squared(d0: float, d1: float, h: float, v: float, kappa: float) -> float:
    """Lower bound of the squared distance within a step; see `SelfCollision.clear_share`."""
    w2 = v**2 + kappa * (min(d0, d1) + v * h + 0.25 * kappa * h**2)
    x = (d0**2 - d1**2 + w2 * h**2) / (2 * w2 * h)
    return d0**2 - w2 * x**2 if 0 < x < h else min(d0, d1) ** 2


def _levers(model: pin.Model, bodies: list[pin.GeometryObject]) -> Array:
    """(n_joints,) m, upper bounds of the distance of any body's points from each joint that moves it; 0 where none."""
    lever = np.zeros(model.njoints)
    for body in bodies:
        body.geometry.computeLocalAABB()
        center = body.placement.act(body.geometry.aabb_center)
        reach = float(np.linalg.norm(center)) + body.geometry.aabb_radius
        for joint in reversed(list(model.supports[body.parentJoint])):
            lever[joint] = max(lever[joint], reach)
            reach += float(np.linalg.norm(model.jointPlacements[joint].translation))
    return lever[1:]
