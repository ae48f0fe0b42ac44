"""The last stage of every command: joint, rate and acceleration limits, and the self-collision distance.

The limits hold until the command expires, however late the next one is.
"""

from dataclasses import dataclass

import numpy as np

from control.commands import posture_after
from pps_vision.errors import InputError
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array, JointVelocity

MAX_HOLD_S = 0.5  # longest time for which a command may be held
_DEG = np.pi / 180
_MARGIN_RAD = 1e-9  # distance at which joints stop before their limits, against rounding
_NEGLIGIBLE_RAD_S = 1e-6  # a smaller excess is clipped, so that a joint at its limit does not stop the others


@dataclass(frozen=True)
class LimitParams:
    """Limits of the robot."""

    joint_rad_s: float = 60 * _DEG
    """Rate limit of arms, torso and neck (neither paper states one)."""
    eyes_rad_s: float = 180 * _DEG
    """Rate limit of the eyes (neither paper states one)."""
    speed_up_s: float = 0.1
    """Time from rest to the rate limit; the acceleration limit is the rate limit divided by it."""
    clearance_m: float = 0.02
    """Smallest self-collision distance."""

    def __post_init__(self) -> None:
        if not (self.joint_rad_s > 0 and self.eyes_rad_s > 0 and self.speed_up_s > 0 and self.clearance_m >= 0):
            raise InputError("limits", f"{self}; expected rates and a time above 0, a distance of at least 0")


def check_times(source: str, stamp_s: float, hold_s: float, last_s: float = -np.inf) -> None:
    """InputError unless a stamp is finite and not before the last one, and a holding time in (0, MAX_HOLD_S]."""
    if not (np.isfinite(stamp_s) and stamp_s >= last_s):
        raise InputError(source, f"stamp {stamp_s} s after {last_s} s; expected a finite one that does not go back")
    if not 0 < hold_s <= MAX_HOLD_S:
        raise InputError(source, f"command held for {hold_s} s; expected more than 0 s, at most {MAX_HOLD_S} s")


def limit(
    params: LimitParams,
    self_collision: SelfCollision,
    posture: Posture,
    wanted: JointVelocity,
    last: JointVelocity | None = None,
    last_q_rad: Array | None = None,
) -> JointVelocity:
    """The command nearest to `wanted` that keeps every limit until it expires; the robot is at `posture` at its stamp.

    If the `last` command leads elsewhere from `last_q_rad` (n_joints,), the posture predicted at its stamp, every limit
    is kept from both postures.  The change from braking to `wanted` is scaled uniformly, separately for the joints that
    move bodies and for the head.  Braking continues along the `last` command (None: the robot rests) and ends where
    that would have ended: if the robot is where it was predicted to be, that path has been checked.  A limit that is
    already exceeded is not exceeded further: a joint beyond its limit stays or returns, and two bodies that are too
    near or overlap may only separate.  The self-collision distance takes precedence over the acceleration limit.

    InputError if a rate or stamp is not finite, the stamp precedes the last, or `hold_s` is out of (0, MAX_HOLD_S].
    """
    check_times("command", wanted.stamp_s, wanted.hold_s, -np.inf if last is None else last.stamp_s)
    robot = posture.robot
    moves_bodies = self_collision.moving
    if wanted.dq_rad_s.shape != (robot.n_joints,) or not np.isfinite(wanted.dq_rad_s).all():
        raise InputError("command", f"rates {wanted.dq_rad_s}; expected {robot.n_joints} finite numbers in rad/s")
    postures = [posture.q_rad]
    is_as_predicted = False
    if last is not None and last_q_rad is not None:
        predicted = posture_after(last_q_rad, [last], last.stamp_s, wanted.stamp_s, 0.0)
        is_as_predicted = np.allclose(posture.q_rad, predicted, rtol=0.0, atol=_MARGIN_RAD)
        if not is_as_predicted:
            postures.append(predicted)

    def clear_share(rates: Array) -> float:
        """Share of the motion at rates (n_joints,) that is free from every posture."""
        change = wanted.hold_s * rates
        return min(self_collision.clear_share(q, change, params.clearance_m) for q in postures)

    rate = fastest(params, robot) * min(1.0, wanted.hold_s / params.speed_up_s)  # from which it stops within hold_s
    lower = np.clip((robot.lower_rad + _MARGIN_RAD - np.min(postures, axis=0)) / wanted.hold_s, -rate, 0.0)
    upper = np.clip((robot.upper_rad - _MARGIN_RAD - np.max(postures, axis=0)) / wanted.hold_s, 0.0, rate)
    rates, change = change_limits(params, robot, wanted.stamp_s, last)
    brake = rates
    if last is not None and rates.any():  # the last command ends where it would have
        brake = min(1.0, (last.hold_s - (wanted.stamp_s - last.stamp_s)) / wanted.hold_s) * rates
    brake = np.clip(brake, lower, upper)
    dq = np.clip(wanted.dq_rad_s, lower, upper)
    dq = np.where(np.abs(dq - wanted.dq_rad_s) <= _NEGLIGIBLE_RAD_S, dq, wanted.dq_rad_s)
    lower = np.minimum(np.maximum(lower, rates - change), brake)
    upper = np.maximum(np.minimum(upper, rates + change), brake)
    for group in (moves_bodies, ~moves_bodies):
        share = _largest_share(brake[group], dq[group], lower[group], upper[group])
        dq[group] = brake[group] + share * (dq[group] - brake[group])
    dq = np.clip(dq, lower, upper)  # against rounding
    free = np.where(moves_bodies, clear_share(dq) * dq, dq)
    if np.any((free < lower) | (free > upper)):  # too sudden a stop: brake along the last command
        if not is_as_predicted:
            brake = brake * clear_share(brake)
        free = np.where(moves_bodies, brake, dq)
    return JointVelocity(wanted.stamp_s, free, wanted.hold_s)


def change_limits(params: LimitParams, robot: Robot, stamp_s: float, last: JointVelocity | None) -> tuple[Array, Array]:
    """Rates (n_joints,) at a stamp after the last command, and their largest change by the acceleration limit."""
    elapsed_s = MAX_HOLD_S if last is None else stamp_s - last.stamp_s
    rates = last.dq_rad_s if last is not None and elapsed_s < last.hold_s else np.zeros(robot.n_joints)
    return rates, fastest(params, robot) / params.speed_up_s * elapsed_s


def fastest(params: LimitParams, robot: Robot) -> Array:
    """(n_joints,) rate limits."""
    rates = np.full(robot.n_joints, params.joint_rad_s)
    rates[robot.indices(robot.names.gaze_joints[2:])] = params.eyes_rad_s
    return rates


def _largest_share(start: Array, end: Array, lower: Array, upper: Array) -> float:
    """The largest share in [0, 1] of the way from `start` to `end` (k,) that stays within the limits (k,)."""
    way = end - start
    room = np.where(way > 0, upper - start, start - lower)
    moved = way != 0
    return float(np.min(room[moved] / np.abs(way[moved]), initial=1.0))
