"""Move away from what the skin predicts to touch it, or reach for it (R eq. 6), and return home."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from control.arm import ArmParams, KeepIn, arm_velocity
from control.limits import MAX_HOLD_S, check_times
from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity

Mode = Literal["idle", "avoid", "reach", "return"]


@dataclass(frozen=True)
class AvoidanceParams:
    """Response of one arm to its skin (R, "Avoidance and reaching"; FACTS §3)."""

    home_arm_rad: tuple[float, ...]
    """(k,) the arm's joints at home."""
    side: Literal["left", "right"] = "left"
    """The arm."""
    behaviour: Literal["avoid", "reach"] = "avoid"
    """Move against the normal of the control point, or along it."""
    threshold: float = 0.4
    """Activation above which a taxel responds."""
    speed_m_s: float = 0.10
    """Speed of the control point."""
    radius_m: float = 0.20
    """The palm stays this near to its place at home."""
    confirm_s: float = 0.15
    """Time above threshold before the arm responds: the estimated velocity of an object that stops overshoots for one
    to three frames."""
    persist_s: float = 0.3
    """Time the response outlasts the activation."""
    return_per_s: float = 3.0
    """Rate of the return home, of the angles left."""
    ease_in_s: float = 0.3
    """Time over which the return speeds up."""
    at_home_rad: float = np.deg2rad(0.2)
    """Largest angle from home that counts as being there."""
    arm: ArmParams = field(default_factory=ArmParams)
    """Limits and damping of the arm."""

    def __post_init__(self) -> None:
        if self.side not in ("left", "right") or self.behaviour not in ("avoid", "reach"):
            raise ValueError(f"{self.behaviour!r} by the {self.side!r} arm; expected avoid or reach, left or right")
        if not self.home_arm_rad or not np.isfinite(self.home_arm_rad).all():
            raise ValueError(f"home_arm_rad {self.home_arm_rad}; expected an angle for each joint")
        times = self.confirm_s, self.persist_s, self.ease_in_s
        above_0 = self.threshold, self.speed_m_s, self.radius_m, self.return_per_s, self.at_home_rad
        if not (all(time >= 0 for time in times) and all(value > 0 for value in above_0) and self.threshold <= 1):
            raise ValueError(f"{self}; expected no time below 0, the rest above, a threshold of at most 1")


@dataclass(frozen=True, slots=True)
class AvoidanceState:
    """What the arm does."""

    mode: Mode = "idle"
    since_s: float = 0.0
    """Stamp of the last activation that it responds to; on the way home, when that began."""
    active_since_s: float = np.inf
    """Since when some taxel is above threshold without a break; inf if none is."""
    frame: str = ""
    """Frame of the control point."""
    point: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) control point in `frame`, m."""
    velocity_root: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) its commanded velocity, m/s."""
    stamp_s: float = -np.inf
    """Stamp of the last step."""


@dataclass(frozen=True, slots=True)
class Response:
    """What is commanded, for reports."""

    mode: Mode
    velocity_root: Array
    """(3,) m/s of the control point; zero unless the arm avoids or reaches."""
    point_root: Array
    """(3,) control point, m; NaN unless the arm avoids or reaches."""


def step(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    skin: Skin,
    activations: ArrayLike,
    stamp_s: float,
    may_reach: bool = False,
    hold_s: float = MAX_HOLD_S,
    self_collision: SelfCollision | None = None,
) -> tuple[AvoidanceState, JointVelocity, Response]:
    """One control step from the activations (n,) of `skin`, the taxels this arm carries.

    The arm reaches only while `may_reach`: while the reachable-space map calls the object reachable; it avoids in any
    case.  The command may be held for `hold_s`; the response keeps clear of the bodies of `self_collision`.  InputError
    if an activation is not in [0, 1], if there is not one per taxel, or if the stamp is not finite or before the last
    one.
    """
    check_times("avoidance", stamp_s, hold_s, state.stamp_s)
    found = control_point(params.threshold, posture, skin, np.asarray(activations, dtype=float))
    state = _next(params, state, posture, found, stamp_s, may_reach or params.behaviour == "avoid")
    state = replace(state, stamp_s=stamp_s)
    if state.mode in ("avoid", "reach"):
        dq = _respond(params, state, posture, hold_s, self_collision)
        response = Response(state.mode, state.velocity_root, posture.point(state.frame, state.point))
    else:
        dq = _return(params, posture, stamp_s - state.since_s) if state.mode == "return" else 0 * posture.q_rad
        response = Response(state.mode, np.zeros(3), np.full(3, np.nan))
    return state, JointVelocity(stamp_s, dq, hold_s), response


def control_point(
    threshold: float, posture: Posture, skin: Skin, activations: Array
) -> tuple[str, Array, Array] | None:
    """R eq. 6: the frame that carries P, P (3,) in the root frame, and the unit normal N (3,) there.

    P = Σ a p / Σ a and N = Σ a n / Σ a over the taxels above threshold of the body part with the largest Σ a; None
    where no taxel is above threshold.
    """
    n = len(skin.taxel_ids)
    if activations.shape != (n,) or not np.all((activations >= 0) & (activations <= 1)):
        raise InputError("avoidance", f"activations {activations}; expected {n} numbers in [0, 1], one a taxel")
    weights = np.where(activations > threshold, activations, 0.0)
    if not weights.any():
        return None
    by_part = np.bincount(skin.part_index, weights, len(skin.parts))
    part = int(np.argmax(by_part))
    shares = np.where(skin.part_index == part, weights, 0.0) / by_part[part]
    positions, normals = skin.at(posture)
    normal = shares @ normals
    return skin.parts[part].frame, shares @ positions, normal / max(float(np.linalg.norm(normal)), 1e-9)


def _next(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    found: tuple[str, Array, Array] | None,
    stamp_s: float,
    allowed: bool,
) -> AvoidanceState:
    """Respond to a confirmed activation while allowed, keep responding for a while, then return, then rest."""
    found = found if allowed else None
    state = replace(state, active_since_s=np.inf if found is None else min(state.active_since_s, stamp_s))
    responding = state.mode in ("avoid", "reach")
    if found is not None and (responding or stamp_s - state.active_since_s > params.confirm_s - 1e-6):
        frame, p_root, normal = found
        velocity = normal * (params.speed_m_s if params.behaviour == "reach" else -params.speed_m_s)
        point = move_points(inverse(posture.T_root(frame)), p_root)
        return AvoidanceState(params.behaviour, stamp_s, state.active_since_s, frame, point, velocity)
    if responding and (not allowed or stamp_s - state.since_s > params.persist_s):
        return AvoidanceState("return", stamp_s, state.active_since_s)
    if state.mode == "return" and np.abs(_angles_from_home(params, posture)).max() < params.at_home_rad:
        return AvoidanceState("idle", stamp_s, state.active_since_s)
    return state


def _respond(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    hold_s: float,
    self_collision: SelfCollision | None,
) -> Array:
    """Joint rates that move the control point as commanded, the palm staying within its sphere."""
    palm, q_home = _palm(params, posture), posture.q_rad.copy()
    q_home[_columns(params, posture)] = params.home_arm_rad
    keep_in = KeepIn(palm, posture.robot.at(q_home).point(palm), params.radius_m)
    task = state.frame, state.point, state.velocity_root
    return arm_velocity(params.arm, posture, params.side, *task, params.home_arm_rad, keep_in, hold_s, self_collision)


def _return(params: AvoidanceParams, posture: Posture, elapsed_s: float) -> Array:
    """Joint rates towards home: eased in and out, the palm no faster than the control point of a response."""
    dq = np.zeros_like(posture.q_rad)
    dq[_columns(params, posture)] = -params.return_per_s * _angles_from_home(params, posture)
    palm_speed = np.linalg.norm(posture.jacobian(_palm(params, posture))[:3] @ dq)
    excess = max(palm_speed / params.speed_m_s, np.abs(dq).max() / params.arm.max_rate_rad_s, 1.0)
    eased = elapsed_s / params.ease_in_s if elapsed_s < params.ease_in_s else 1.0
    return np.asarray(dq * eased / excess)


def _columns(params: AvoidanceParams, posture: Posture) -> list[int]:
    """Where the arm's joints are in the configuration vector."""
    return posture.robot.indices(posture.robot.names.arm(params.side))


def _palm(params: AvoidanceParams, posture: Posture) -> str:
    """The frame of the arm's palm."""
    return posture.robot.names.palms[("left", "right").index(params.side)]


def _angles_from_home(params: AvoidanceParams, posture: Posture) -> Array:
    """(k,) rad."""
    return np.asarray(posture.q_rad[_columns(params, posture)] - params.home_arm_rad)
