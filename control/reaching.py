"""Reach for an object that is predicted to touch the arm, with the taxel that touches it first (R, eq. 6 with +).

Beyond R: the taxel moves towards the object instead of along its normal, and goes on when the object stops.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from control import avoidance
from control.arm import ArmParams, MovingPoint
from control.avoidance import ArmInput, ArmMotion, ArmState, Mode, Response, ResponseParams
from pps_vision.errors import InputError
from pps_vision.geometry.paths import passing_distances
from pps_vision.robot.bare_links import NearestPoint
from pps_vision.robot.skin import TOUCH_RADIUS_M
from pps_vision.types import Array, Mask

_MIN_SPEED_M_S = 1e-6  # a slower control point never arrives
_PATH_HORIZON_S = 10.0  # prediction horizon of the path: half a metre at 5 cm/s, R's slowest


@dataclass(frozen=True)
class ReachingParams(ResponseParams):
    """Parameters of reaching."""

    mode: ClassVar[Mode] = "reach"
    confirmation_s: float = 0.1
    """Time for which the object must be within reach: a filter's position overshoots when the object stops."""
    wait_s: float = 1.0
    """Time after the last activation in which the arm may still begin: the object may come into reach as it stops."""
    persist_s: float = 3.0
    """Time for which reaching outlasts the activation: an object that waits to be touched has no time to contact."""
    damping_m: float = 0.03
    """Second damping, tried beside that of `arm`: with little damping joints turn fast against each other, and the
    last stage, which proves the whole motion clear of the body, slows them all; with more the arm stops at singular
    postures."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.damping_m > 0:
            raise InputError("arm", f"damping_m {self.damping_m}; expected a positive number")


class TaxelMotion(NamedTuple):
    """A motion of one taxel to the object."""

    contact_s: float  # time to the touch at the present speed
    point: MovingPoint  # the taxel
    dq: Array  # (n_joints,) rad/s


def step(
    params: ReachingParams,
    state: ArmState,
    arm: ArmInput,
    is_reachable: Callable[[int], bool],
    reaches: Mask | None = None,
) -> tuple[ArmState, Response]:
    """Advance reaching by one control step; `is_reachable`: the reachable-space map's verdict on the object, for the
    body part of a taxel (its number); `reaches`: the taxels (n,) to reach with (default: all).

    The arm reaches with the body part that the object's path ends at, also after the object has stopped, and returns
    home once the object is lost or out of that part's reach.  InputError as in `avoidance.step`.
    """
    state = avoidance.observed(state, arm)
    is_known = arm.track.is_known
    if is_known and np.any(arm.activations > params.threshold):
        state = replace(state, felt_s=arm.stamp_s)
    since_felt_s = arm.stamp_s - state.felt_s
    is_active = is_known and since_felt_s <= (params.wait_s if state.mode == "idle" else 0.0)
    target = state.target_taxel if state.mode == "reach" else None
    if is_active:
        target = target_taxel(params, arm, state, reaches)
    state = avoidance.next_state(params, state, arm, is_active, target is not None and is_reachable(target))
    dq = np.zeros_like(arm.posture.q_rad)
    if state.mode == "reach" and target is not None:
        motion = ArmMotion(params, arm, avoidance.clearance_rows(arm, other_parts(arm, target)))
        touch = _fastest_touch(params, motion, target)
        state = replace(state, target_taxel=target, points=(touch.point,))
        dq = touch.dq
    elif state.mode == "return":
        dq = avoidance.return_home(params, arm, arm.stamp_s - state.since_s, avoidance.clearance_rows(arm, []))
    return state, avoidance.response(state, arm, dq)


def target_taxel(params: ReachingParams, arm: ArmInput, state: ArmState, reaches: Mask | None = None) -> int:
    """Number of the taxel, of those to reach with, that the object's path passes nearest with the arm at home, since
    the arm's own motion does not change the path.

    The path continues the position history: the estimated velocity overshoots when the object stops.
    """
    taxels, _ = arm.skin.at(avoidance.at_home(params, arm.posture))
    first_s, first = state.positions[0]
    last_s, last = state.positions[-1]
    velocity = (last - first) / (last_s - first_s) if last_s > first_s else arm.track.velocity
    distances = passing_distances(taxels, arm.track.position, velocity, _PATH_HORIZON_S)
    return int((distances if reaches is None else np.where(reaches, distances, np.inf)).argmin())


def _fastest_touch(params: ReachingParams, motion: ArmMotion, target: int) -> TaxelMotion:
    """The touch with the taxel and the damping that make contact first, behind the last stage."""
    touches = []
    for arm_params in (replace(params.arm, damping_m=params.damping_m), params.arm):
        touch = first_touch(motion, arm_params, target)
        share = motion.unhindered_share(touch.dq[motion.constraints.columns])
        touches.append(touch._replace(contact_s=touch.contact_s / max(share, _MIN_SPEED_M_S)))
    return min(touches, key=lambda touch: touch.contact_s)


def first_touch(motion: ArmMotion, arm_params: ArmParams, target: int) -> TaxelMotion:
    """The earliest touch with a taxel of the part and side of the taxel `target`, at the speed that is allowed now."""
    arm = motion.arm
    positions, normals = arm.skin.at(arm.posture)
    same_part = arm.skin.part_index == arm.skin.part_index[target]
    touches = []
    for k in np.flatnonzero(same_part & (normals @ normals[target] > 0)).tolist():
        d = arm.track.position - positions[k]
        distance = float(np.linalg.norm(d))
        gap = max(distance - arm.object_radius_m, 0.0)
        velocity = min(motion.params.speed_m_s, gap / arm.hold_s) * d / max(distance, 1e-9)  # stops at the surface
        point = MovingPoint(*arm.skin.taxel(k), velocity)
        dq = motion.rates((point,), arm_params)
        speed = float(d @ arm.posture.jacobian(point.frame, point.point)[:3] @ dq) / max(distance, 1e-9)
        contact_s = max(gap - TOUCH_RADIUS_M, 0.0) / max(speed, _MIN_SPEED_M_S)
        touches.append(TaxelMotion(contact_s, point, dq))
    return min(touches, key=lambda touch: touch.contact_s)


def other_parts(arm: ArmInput, target: int) -> list[NearestPoint]:
    """The taxel nearest to the object of each body part but that of the taxel `target`."""
    target_frame, _ = arm.skin.taxel(target)
    return [near for near in avoidance.nearest_taxels(arm) if near.frame != target_frame]
