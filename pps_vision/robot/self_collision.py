"""Self-collision distance: how far apart the two arms and the trunk are, by coal through Pinocchio."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pps_vision.robot.model import Body, Robot
from pps_vision.types import Array, Mask

_SHORTEST_STEP = 1 / 512  # smallest checked share of a motion
_MOST_STEPS = 10  # bounds the time of a check
_ACCURACY_M = 1e-5  # margin of distances above the smallest allowed one; coal repeats itself within 1e-6 m
_AXIS_M = 5e-5  # coal's directions give its distances within this (2.3e-5 at most for cylinders that are apart)
_NO_MOTION_M = 1e-12  # bodies that move by less are taken to rest


class SelfCollision:
    """Distances between the bodies of the left arm, the right arm and the trunk.

    Bodies of the same limb are not compared, nor adjacent bodies (upper arm and chest), which touch by construction.
    """

    def __init__(self, robot: Robot, ignored: tuple[str, ...] = ()) -> None:
        """Compare all `robot.bodies` but those named in `ignored`."""
        self._robot = robot
        self._model = robot.model
        self._data = robot.model.createData()
        self._bodies = robot.bodies
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

        for (i, first), (j, second) in combinations(bodies, 2):
            a = first.parentJoint
            b = second.parentJoint
            if limb(a) != limb(b) and carrier(max(a, b)) != min(a, b):  # Pinocchio numbers parents before children
                self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._distances = pin.GeometryData(self._geometry)
        self._pairs = [self._pair(pair.first, pair.second) for pair in self._geometry.collisionPairs]
        self._turns: Mask = np.array([pair.turn for pair in self._pairs])
        self._lever_m = _levers(robot.model, [body for _, body in bodies])

    @property
    def moving(self) -> Mask:
        """(n_joints,) whether a joint moves a body."""
        return self._lever_m > 0

    def distance_m(self, q_rad: ArrayLike) -> float:
        """The smallest distance at a configuration (n_joints,); negative where bodies overlap."""
        q = self._robot.complete(np.asarray(q_rad, dtype=float))
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._distances, q)
        return float(self._distances.distanceResults[nearest].min_distance)

    def parting(self, q_rad: ArrayLike, within_m: float, joints: Sequence[int]) -> tuple[Array, Array]:
        """The distances (k,) m of pairs nearer than `within_m` that `joints` (n,) move, and their rates per joint rate.

        The rates (k, n), m/rad, are n·(v₂ − v₁) of the nearest points along their connection n, both bodies taken to
        carry the same point p: [n, p×n] times the difference of their spatial Jacobians.
        """
        q = self._robot.complete(np.asarray(q_rad, dtype=float))
        self.distance_m(q)
        pin.computeJointJacobians(self._model, self._data, q)
        results = self._distances.distanceResults
        moved = np.flatnonzero(self._turns[:, joints].any(axis=1)).tolist()
        near = [k for k in moved if results[k].min_distance < within_m]
        rates = np.empty((len(near), len(joints)))
        for row, k in enumerate(near):
            n = results[k].normal
            p = results[k].getNearestPoint1()
            J_first, J_second = (
                pin.getJointJacobian(self._model, self._data, joint, pin.ReferenceFrame.WORLD)
                for joint in self._pairs[k].joints
            )
            rates[row] = np.concatenate([n, pin.skew(p) @ n]) @ self._robot.fold(J_second - J_first)[:, joints]
        return np.array([results[k].min_distance for k in near]), rates

    def clear_share(self, q_rad: Array, change_rad: Array, clearance_m: float) -> float:
        """The share in [0, 1] of a straight motion along which the distance provably stays at `clearance_m` or more.

        The motion leads from `q_rad` to `q_rad + change_rad` (n_joints,).  Two bodies that are nearer already, or
        overlap, may not come nearer than at the start.
        """
        q_rad, change_rad = self._robot.complete(q_rad), self._robot.complete(change_rad, is_change=True)
        turn = np.abs(change_rad) * self.moving
        if turn @ self._lever_m <= _NO_MOTION_M:
            return 1.0
        enough_m = clearance_m + _ACCURACY_M
        d0 = self.distance_m(q_rad)
        if d0 >= enough_m + _ACCURACY_M:
            return self._free_share(q_rad, change_rad, clearance_m, d0)
        distances = [result.min_distance for result in self._distances.distanceResults]
        near = {k: min(d, enough_m) for k, d in enumerate(distances) if d < enough_m + _ACCURACY_M}
        turned = np.any(self._turns & (turn > 0), axis=1)
        leaving = {k: least for k, least in near.items() if turned[k]}
        share = self._leaving_share(q_rad, change_rad, leaving) if leaving else 1.0
        others = [k for k in np.flatnonzero(turned).tolist() if k not in near]
        if not (share and others):
            return share
        active = self._distances.activeCollisionPairs
        passive = set(range(len(self._pairs))) - set(others)
        try:
            for k in passive:
                active[k] = False
            return share * self._free_share(q_rad, share * change_rad, clearance_m, self.distance_m(q_rad))
        finally:
            for k in passive:
                active[k] = True

    def _free_share(self, q_rad: Array, change_rad: Array, least: float, d0: float) -> float:
        """`clear_share` of the active pairs, from a start at the distance `d0` above `least`.

        Let d₀, d₁ be the distances at the ends of a step and m the smallest within.  The nearest points of that
        instant move at right angles to their connection, relatively by at most v and with an acceleration of at most κ
        (a step of length h of the whole motion): d² ≤ m² + w² x² at x from it, w² = v² + κ (m + v h + κ h²/4).  So
        m² ≥ d₀² − w² x² at the x where the bounds from both ends meet, or m is d₀ or d₁.
        """
        turn = np.abs(change_rad) * self.moving
        v = float(turn @ self._lever_m)
        kappa = float(turn.sum()) * v
        shortest = max(_SHORTEST_STEP, 50 * _ACCURACY_M / v)
        share = 0.0
        longest = 1.0
        for _ in range(_MOST_STEPS):
            to_graze = 2 * sqrt(d0**2 - least**2) / v  # a step that is free if the distance after it is again d0
            h = min(max(to_graze, shortest), longest, 1.0 - share)
            d1 = self.distance_m(q_rad + (share + h) * change_rad)
            if d1 >= least + _ACCURACY_M and _smallest_squared(d0, d1, h, v, kappa) >= least**2:
                share += h
                if share >= 1.0:
                    return 1.0
                d0 = d1
                longest = 1.0
            elif h <= shortest:
                break
            else:
                longest = 0.5 * h
        return share

    def _leaving_share(self, q_rad: Array, change_rad: Array, least: Mapping[int, float]) -> float:
        """The share in [0, 1] of a motion along which the pairs of these numbers stay at `least` or more.

        The distance of convex bodies, negative where they overlap, is the largest separation s along any direction n.
        Along one that turns with what carries both, s is the smallest of n·(b − a) over their points, with an
        acceleration of at most κ: within a step s lies above the parabola through its ends with the curvature κ.
        """
        lowest = np.array(list(least.values()))
        turns = np.array([np.abs(change_rad) * self._pairs[k].turn for k in least])
        kappa = turns.sum(axis=1) * (turns @ self._lever_m)
        share = 0.0
        h = 1.0
        axes = self._axes(q_rad, least)
        s0 = self._separations(q_rad, axes)
        for _ in range(2 * _MOST_STEPS):
            h = min(h, 1.0 - share)
            q1 = q_rad + (share + h) * change_rad
            s1 = self._separations(q1, axes)
            start = np.where(s0 >= lowest - _AXIS_M, np.minimum(s0, lowest), lowest)
            if np.all(s1 >= lowest) and np.all(_lowest(s0, s1, kappa * h**2) >= start):
                share += h
                if share >= 1.0:
                    return 1.0
                h *= 2
                axes = self._axes(q1, least)
                s0 = self._separations(q1, axes)
            elif h <= _SHORTEST_STEP:
                break
            else:
                h *= 0.5
        return share

    def _axes(self, q_rad: Array, pairs: Iterable[int]) -> dict[int, Array]:
        """By pair, the direction (3,) in which its bodies are apart, in the frame of the joint that carries both."""
        self.distance_m(q_rad)
        results = self._distances.distanceResults
        return {k: results[k].normal @ self._data.oMi[self._pairs[k].carrier].rotation for k in pairs}

    def _separations(self, q_rad: Array, axes: Mapping[int, Array]) -> Array:
        """(n,) m, the separations of pairs along their axes: lower bounds of their distances."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._distances, q_rad)
        separations = []
        for k, axis in axes.items():
            pair = self._pairs[k]
            n = self._data.oMi[pair.carrier].rotation @ axis
            a = self._distances.oMg[pair.first]
            b = self._distances.oMg[pair.second]
            gap = n @ (b.translation - a.translation) - _extent(self._bodies[pair.first], n @ a.rotation)
            separations.append(gap - _extent(self._bodies[pair.second], n @ b.rotation))
        return np.array(separations)

    def _pair(self, first: int, second: int) -> "_Pair":
        joints = tuple(self._geometry.geometryObjects[i].parentJoint for i in (first, second))
        supports = [set(self._model.supports[joint]) for joint in joints]
        turn = np.isin(np.arange(1, self._model.njoints), list(supports[0] ^ supports[1]))
        return _Pair(first, second, joints, max(supports[0] & supports[1]), turn)


class _Pair(NamedTuple):
    """Two bodies whose distance is measured."""

    first: int
    second: int
    joints: tuple[int, ...]  # which carry them
    carrier: int  # the last joint that moves both
    turn: Mask  # (n_joints,) whether a joint moves one against the other


def _extent(body: Body, direction: Array) -> float:
    """m from the centre of a body to its farthest point in a direction (3,) of unit length, in its frame."""
    x, y, z = np.abs(direction)
    if body.shape == "sphere":
        return body.size_m[0]
    if body.shape == "cylinder":
        radius, length = body.size_m
        return float(radius * hypot(x, y) + 0.5 * length * z)
    return float(0.5 * (np.array(body.size_m) @ (x, y, z)))


def _lowest(s0: Array, s1: Array, bend: Array) -> Array:
    """The lowest values (n,) of parabolas with the second derivative `bend` on [0, 1] that end at s0 and s1."""
    bend = np.maximum(bend, 1e-300)
    at = np.clip(0.5 - (s1 - s0) / bend, 0.0, 1.0)
    return np.asarray(s0 + (s1 - s0) * at - 0.5 * bend * at * (1 - at))


def _smallest_squared(d0: float, d1: float, h: float, v: float, kappa: float) -> float:
    """Lower bound of the squared distance within a step; see `SelfCollision._free_share`."""
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
