"""Joint rates of an arm that withdraws, reaches or goes home, within all that they obey."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from control import reaching
from control.arm import ArmConstraints, ArmParams, KeepIn, MovingPoint, arm_constraints, arm_velocity
from control.avoidance_params import AvoidanceParams, AvoidanceState
from control.limits import LimitParams
from control.path_clearance import direction_off_path
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.bare_links import Near
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Track3D

LINK_CLEARANCE_M = 0.03
"""Links without taxels, and while the arm reaches the taxels of its other body parts, come no nearer to the object."""
_RETURN_PER_S = 3.0  # rate of the return home, of the angles left
_EASE_IN_S = 0.3  # over which the return speeds up


@dataclass(frozen=True)
class RespondingArm:
    """An arm, and what its joint rates obey in one frame."""

    params: AvoidanceParams
    posture: Posture
    within: ArmConstraints
    hold_s: float
    self_collision: SelfCollision | None

    @classmethod
    def of(
        cls,
        params: AvoidanceParams,
        posture: Posture,
        hold_s: float,
        self_collision: SelfCollision | None,
        rows: tuple[Array, Array],
    ) -> "RespondingArm":
        """The palm stays within its sphere, the rates within the `rows`."""
        palm = _palm(params, posture)
        keep_in = KeepIn(palm, at_home(params, posture).point(palm), params.radius_m)
        of_arm = posture, params.side, params.home_arm_rad, keep_in, hold_s, self_collision, rows
        return cls(params, posture, arm_constraints(params.arm, *of_arm), hold_s, self_collision)

    def velocity(self, points: tuple[MovingPoint, ...], params: ArmParams | None = None) -> Array:
        """Joint rates (n_joints,) that move control points as commanded, none of them faster than `speed_m_s`."""
        dq = arm_velocity(params or self.params.arm, self.posture, self.within, points)
        jacobians = (self.posture.jacobian(one.frame, one.point)[:3] for one in points)
        fastest = max(float(np.linalg.norm(jacobian @ dq)) for jacobian in jacobians)
        return dq * min(1.0, self.params.speed_m_s / max(fastest, 1e-9))

    def free_share(self, rates: Array) -> float:
        """The share of rates (k,) that the last stage, which proves the motion clear of the body, lets through."""
        if self.self_collision is None:
            return 1.0
        change = np.zeros_like(self.posture.q_rad)
        change[self.within.columns] = self.hold_s * rates
        return self.self_collision.clear_share(self.posture.q_rad, change, LimitParams().clearance_m)


def respond(
    arm: RespondingArm, state: AvoidanceState, skin: Skin, track: Track3D | None
) -> tuple[AvoidanceState, Array]:
    """Joint rates that reach for the object of a `track`, or withdraw from it."""
    if not arm.params.each_taxel:
        return state, arm_velocity(arm.params.arm, arm.posture, arm.within, state.points)
    if state.mode == "reach" and track is not None and state.aimed_at is not None:
        return _reach(arm, state, state.aimed_at, skin, track)
    return _withdraw(arm, state, skin, track)


def _reach(
    arm: RespondingArm, state: AvoidanceState, aimed_at: int, skin: Skin, track: Track3D
) -> tuple[AvoidanceState, Array]:
    """With the taxel and the damping that touch the object first."""
    ways = []
    for params in (replace(arm.params.arm, damping_m=arm.params.reach_damping_m), arm.params.arm):
        velocity = partial(arm.velocity, params=params)
        way = reaching.first_to_touch(arm.params.speed_m_s, aimed_at, arm.posture, skin, track, velocity)
        free = arm.free_share(way.dq[arm.within.columns])
        ways.append(way._replace(touches_s=way.touches_s / max(free, reaching.AT_REST_M_S)))
    _, point, dq = min(ways, key=lambda way: way.touches_s)
    return replace(state, points=(point,)), dq


def _withdraw(
    arm: RespondingArm, state: AvoidanceState, skin: Skin, track: Track3D | None
) -> tuple[AvoidanceState, Array]:
    """Against the taxels' normals, or off the path of the object."""
    columns, aside = arm.within.columns, state.aside

    def rates_towards(direction: Array | None) -> Array:
        return arm.velocity(_moved(state.points, direction))[columns]

    if track is not None and arm.params.clear_m and state.mode == "avoid":
        on = arm.posture, columns, skin, track, rates_towards, arm.params.clear_m
        aside = direction_off_path(*on, aside, arm.free_share) if skin.parts else None
    state = replace(state, aside=aside, points=_moved(state.points, aside))
    return state, arm.velocity(state.points)


def _moved(points: tuple[MovingPoint, ...], direction: Array | None) -> tuple[MovingPoint, ...]:
    """The control points, moving in a direction (3,) if there is one, as fast."""
    if direction is None:
        return points
    return tuple(one._replace(velocity_root=float(np.linalg.norm(one.velocity_root)) * direction) for one in points)


def kept_clear(posture: Posture, near: list[Near], hold_s: float) -> tuple[Array, Array]:
    """Speeds (m, n_joints) of links without taxels towards the object per joint rate, and their largest values (m,)."""
    near = [one for one in near if np.isfinite(one.distance_m)]
    rows = np.empty((len(near), posture.robot.n_joints))
    for k, one in enumerate(near):
        point = move_points(inverse(posture.T_root(one.frame)), one.point_root)
        rows[k] = one.normal @ posture.jacobian(one.frame, point)[:3]
    return rows, np.array([max(one.distance_m - LINK_CLEARANCE_M, 0.0) / hold_s for one in near])


def return_home(params: AvoidanceParams, posture: Posture, elapsed_s: float, rows: tuple[Array, Array]) -> Array:
    """Joint rates towards home: eased in and out, the palm no faster than the control point of a response, and no
    faster than the `rows` of links near the object allow."""
    dq = np.zeros_like(posture.q_rad)
    dq[_columns(params, posture)] = -_RETURN_PER_S * angles_from_home(params, posture)
    palm_speed = np.linalg.norm(posture.jacobian(_palm(params, posture))[:3] @ dq)
    excess = max(palm_speed / params.speed_m_s, np.abs(dq).max() / params.arm.max_rate_rad_s, 1.0)
    eased = elapsed_s / _EASE_IN_S if elapsed_s < _EASE_IN_S else 1.0
    dq *= eased / excess
    towards = rows[0] @ dq
    return dq * np.min(rows[1][towards > 0] / towards[towards > 0], initial=1.0)


def at_home(params: AvoidanceParams, posture: Posture) -> Posture:
    """The robot with the arm at home."""
    q = posture.q_rad.copy()
    q[_columns(params, posture)] = params.home_arm_rad
    return posture.robot.at(q)


def _columns(params: AvoidanceParams, posture: Posture) -> list[int]:
    """Where the arm's joints are in the configuration vector."""
    return posture.robot.indices(posture.robot.names.arm(params.side))


def _palm(params: AvoidanceParams, posture: Posture) -> str:
    """The frame of the arm's palm."""
    return posture.robot.names.palm(params.side)


def angles_from_home(params: AvoidanceParams, posture: Posture) -> Array:
    """(k,) rad."""
    return np.asarray(posture.q_rad[_columns(params, posture)] - params.home_arm_rad)
