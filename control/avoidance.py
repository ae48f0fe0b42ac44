"""Get out of the way of what the skin feels coming, or reach for it (R eq. 6), and come home."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from control.arm import ArmParams, KeepIn, arm_velocity
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.model import Posture
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity

_ARM_JOINTS = 7

Mode = Literal["idle", "avoid", "reach", "return"]


@dataclass(frozen=True)
class AvoidanceParams:
    """One arm's answer to its skin.

    The point P moves at `speed_m_s` once some taxel's activation has exceeded `threshold` for
    `confirm_s` (the velocity of what stops dead swings back for one to three frames, and that is no
    approach), and until `persist_s` after; the palm stays within `radius_m` of where `home_arm_rad` (the arm's
    joints at home) puts it (R, "Avoidance and reaching"; FACTS §3).
    """

    home_arm_rad: tuple[float, ...]
    side: Literal["left", "right"] = "left"
    behaviour: Literal["avoid", "reach"] = "avoid"
    threshold: float = 0.4
    speed_m_s: float = 0.10
    radius_m: float = 0.20
    confirm_s: float = 0.15
    persist_s: float = 0.3
    return_per_s: float = 3.0
    ease_in_s: float = 0.3
    at_home_rad: float = np.deg2rad(0.2)
    arm: ArmParams = field(default_factory=ArmParams)

    def __post_init__(self) -> None:
        if self.side not in ("left", "right") or self.behaviour not in ("avoid", "reach"):
            raise ValueError(f"{self.behaviour!r} by the {self.side!r} arm; expected avoid or reach, left or right")
        if len(self.home_arm_rad) != _ARM_JOINTS or not np.isfinite(self.home_arm_rad).all():
            raise ValueError(f"home_arm_rad {self.home_arm_rad}; expected {_ARM_JOINTS} angles")
        times = self.confirm_s, self.persist_s, self.ease_in_s
        above_0 = self.threshold, self.speed_m_s, self.radius_m, self.return_per_s, self.at_home_rad
        if not (all(time >= 0 for time in times) and all(value > 0 for value in above_0) and self.threshold <= 1):
            raise ValueError(f"{self}; expected no time below 0, the rest above, a threshold of at most 1")


@dataclass(frozen=True, slots=True)
class AvoidanceState:
    """What the arm does: nothing, answer what it felt last at `since_s` by moving `point` (3,) of
    `frame` at `velocity_root` (3,), or return home since then.  `felt_since_s`: since when it feels
    something without a break, inf if it does not."""

    mode: Mode = "idle"
    since_s: float = 0.0
    felt_since_s: float = np.inf
    frame: str = ""
    point: Array = field(default_factory=lambda: np.zeros(3))
    velocity_root: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, slots=True)
class Response:
    """For reports: what is commanded, of which point.  `velocity_root` (3,) m/s is zero and
    `point_root` (3,) NaN unless the arm avoids or reaches."""

    mode: Mode
    velocity_root: Array
    point_root: Array


def step(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    skin: Skin,
    activations: ArrayLike,
    stamp_s: float,
    may_reach: bool = False,
) -> tuple[AvoidanceState, JointVelocity, Response]:
    """One control step from the activations (n,) of `skin`, the taxels this arm carries.

    An arm that reaches does so only while it may: while the reachable-space map calls the object reachable.  To avoid,
    it always may.  ValueError, so that nothing moves, if an activation is NaN or there is not one a taxel.
    """
    felt = control_point(params.threshold, posture, skin, np.asarray(activations, dtype=float))
    state = _next(params, state, posture, felt, stamp_s, may_reach or params.behaviour == "avoid")
    if state.mode in ("avoid", "reach"):
        dq = _answer(params, state, posture)
        response = Response(state.mode, state.velocity_root, posture.point(state.frame, state.point))
    else:
        dq = _homeward(params, posture, stamp_s - state.since_s) if state.mode == "return" else 0 * posture.q_rad
        response = Response(state.mode, np.zeros(3), np.full(3, np.nan))
    return state, JointVelocity(stamp_s, dq), response


def control_point(
    threshold: float, posture: Posture, skin: Skin, activations: Array
) -> tuple[str, Array, Array] | None:
    """R eq. 6: the frame that carries P, P (3,) in the root frame, and the unit normal N (3,) there;
    None where no taxel is above threshold.

    P = Σ a p / Σ a and N = Σ a n / Σ a over those taxels of the most excited body part.
    """
    if activations.shape != (len(skin.taxel_ids),) or np.any(np.isnan(activations)):
        raise ValueError(f"activations {activations}: expected {len(skin.taxel_ids)} numbers, one a taxel, none NaN")
    weights = np.where(activations > threshold, activations, 0.0)
    if not skin.parts:
        return None
    by_part = np.bincount(skin.part_index, weights, len(skin.parts))
    part = int(np.argmax(by_part))
    if by_part[part] == 0:
        return None
    shares = np.where(skin.part_index == part, weights, 0.0) / by_part[part]
    positions, normals = skin.at(posture)
    normal = shares @ normals
    return skin.parts[part].frame, shares @ positions, normal / max(float(np.linalg.norm(normal)), 1e-9)


def _next(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    felt: tuple[str, Array, Array] | None,
    stamp_s: float,
    allowed: bool,
) -> AvoidanceState:
    """Answer what is felt for sure while that is allowed, keep answering a while after, then return, then rest."""
    felt = felt if allowed else None
    state = replace(state, felt_since_s=np.inf if felt is None else min(state.felt_since_s, stamp_s))
    answering = state.mode in ("avoid", "reach")
    if felt is not None and (answering or stamp_s - state.felt_since_s > params.confirm_s - 1e-6):
        frame, p_root, normal = felt
        velocity = normal * (params.speed_m_s if params.behaviour == "reach" else -params.speed_m_s)
        point = move_points(inverse(posture.T_root(frame)), p_root)
        return AvoidanceState(params.behaviour, stamp_s, state.felt_since_s, frame, point, velocity)
    if answering and (not allowed or stamp_s - state.since_s > params.persist_s):
        return AvoidanceState("return", stamp_s, state.felt_since_s)
    if state.mode == "return" and np.abs(_away(params, posture)).max() < params.at_home_rad:
        return AvoidanceState("idle", stamp_s, state.felt_since_s)
    return state


def _answer(params: AvoidanceParams, state: AvoidanceState, posture: Posture) -> Array:
    """Rates that move the control point as commanded, the palm staying within its sphere."""
    palm = _palm(params, posture)
    keep_in = KeepIn(palm, _at_home(params, posture).point(palm), params.radius_m)
    return arm_velocity(
        params.arm, posture, params.side, state.frame, state.point, state.velocity_root, params.home_arm_rad, keep_in
    )


def _homeward(params: AvoidanceParams, posture: Posture, elapsed_s: float) -> Array:
    """Joint rates towards home: eased in and out, the palm no faster than the answer."""
    dq = np.zeros_like(posture.q_rad)
    dq[_columns(params, posture)] = -params.return_per_s * _away(params, posture)
    palm_speed = np.linalg.norm(posture.jacobian(_palm(params, posture))[:3] @ dq)
    excess = max(palm_speed / params.speed_m_s, np.abs(dq).max() / params.arm.max_rate_rad_s, 1.0)
    return np.asarray(dq * min(1.0, elapsed_s / params.ease_in_s) / excess)


def _columns(params: AvoidanceParams, posture: Posture) -> list[int]:
    return posture.robot.indices(posture.robot.names.arm(params.side))


def _palm(params: AvoidanceParams, posture: Posture) -> str:
    return posture.robot.names.palms[("left", "right").index(params.side)]


def _away(params: AvoidanceParams, posture: Posture) -> Array:
    """How far each joint of the arm is from home (k,), rad."""
    return np.asarray(posture.q_rad[_columns(params, posture)] - params.home_arm_rad)


def _at_home(params: AvoidanceParams, posture: Posture) -> Posture:
    """The robot as it is, but for the arm, which is at home."""
    q = posture.q_rad.copy()
    q[_columns(params, posture)] = params.home_arm_rad
    return posture.robot.at(q)
