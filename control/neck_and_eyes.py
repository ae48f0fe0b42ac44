"""Fixate a point with six joints: the eyes converge fast, the neck follows, and the eyes turn back as it does.

Structure and eye gains: the iCub's own controller (Roncone et al., RSS 2016).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from control.differential_kinematics import rate_limits, solve_rates
from control.fixation import checked_target, features
from control.limits import LimitParams, change_limits, check_times, fastest
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array, JointVelocity

# Least-squares weights of the rates, in units of the features.
_WEIGHT = 1e-3  # damping
_NECK_WEIGHT = 0.05  # the neck deviates from its own goal where the eyes cannot compensate
_ROLL_WEIGHT = 1.0  # the neck's roll returns to zero and does not follow


@dataclass(frozen=True)
class NeckAndEyesParams:
    """Gains and limits."""

    eyes_per_s: float = 12.5  # gain on the fixation error (the iCub's own); stable below 2 by the time between commands
    neck_per_s: float = 12.0  # gain of the neck towards where the eyes would look straight ahead (`bench fixation`)
    limits: LimitParams = field(default_factory=LimitParams)  # rates and accelerations


def step(
    params: NeckAndEyesParams,
    posture: Posture,
    p_root: ArrayLike,
    v_root: ArrayLike,
    hold_s: float,
    stamp_s: float,
    last: JointVelocity | None,
) -> JointVelocity:
    """Rates of neck and eyes towards fixation of a point.

    The neck turns to the posture in which the eyes, at their present vergence, would see the point straight ahead with
    tilt, version and the neck's roll at zero: this restoring posture resolves the redundancy.  Together they null x of
    `fixation.features`, J q̇ = −k x − ∂x/∂p v, so that the eyes turn back as the neck comes, at rates near the neck's.
    The optical axes do not diverge before the next command, if that comes after as long as this one after the `last`.
    `p_root` (3,) m is the target at `stamp_s` and `v_root` (3,) m/s its velocity, less that of a point which the trunk
    carries (`head.carried_velocity`: the vestibulo-ocular reflex).  Rates may be held for `hold_s`; their change from
    the `last` command keeps the acceleration limits.  InputError as in `fixation.step`.
    """
    check_times("neck and eyes", stamp_s, hold_s)
    p, v = checked_target(p_root, v_root)
    robot = posture.robot
    neck, eyes = joints(robot)
    q = posture.q_rad
    lower, upper = rate_limits(q, robot.lower_rad, robot.upper_rad, fastest(params.limits, robot), 1 / hold_s)
    rates, change = change_limits(params.limits, robot, stamp_s, last)
    lower, upper = np.clip([rates - change, rates + change], lower, upper)
    preferred = np.zeros(robot.n_joints)
    weights = np.full(robot.n_joints, _WEIGHT)
    preferred[neck] = _follow(params, posture, neck, p, v, (lower[neck], upper[neck]))
    weights[neck] = _NECK_WEIGHT
    x, dx_dq, dx_dp = features(posture, p)
    left, right = eyes[1:]
    converging = np.zeros((1, robot.n_joints))
    converging[0, left] = -1.0
    converging[0, right] = 1.0
    since_s = stamp_s - last.stamp_s if last is not None else 0.0
    period_s = since_s if 0 < since_s < hold_s else hold_s
    most = [(q[left] - q[right]) / period_s]
    head = neck + eyes
    limits = lower[head], upper[head]
    dx = -params.eyes_per_s * x - dx_dp @ v
    dq = np.zeros(robot.n_joints)
    dq[head] = solve_rates(dx_dq[:, head], dx, preferred[head], weights[head], limits, converging[:, head], most)
    return JointVelocity(stamp_s, dq, hold_s)


def joints(robot: Robot) -> tuple[list[int], list[int]]:
    """Where the neck's joints (yaw, pitch, others such as roll) and the eyes' three are in the configuration vector."""
    names = robot.names
    moving = robot.moving(names.left_eye)
    yaw, pitch, *eyes = names.gaze_joints
    others = moving[min(moving.index(yaw), moving.index(pitch)) : moving.index(eyes[0])]
    return robot.indices((yaw, pitch, *(j for j in others if j not in (yaw, pitch)))), robot.indices(tuple(eyes))


def _follow(
    params: NeckAndEyesParams, posture: Posture, neck: list[int], p: Array, v: Array, limits: tuple[Array, Array]
) -> Array:
    """Rates of the neck (k,) towards the posture in which the point is straight ahead of eyes that look ahead."""
    robot = posture.robot
    tilt, left, right = joints(robot)[1]
    q = posture.q_rad.copy()
    version = 0.5 * (q[left] + q[right])
    q[tilt] = 0.0
    q[[left, right]] -= version
    x, dx_dq, dx_dp = features(robot.at(q), p)
    wanted = -params.neck_per_s * x[1:] - dx_dp[1:] @ v
    weights = np.full(len(neck), _ROLL_WEIGHT)
    weights[:2] = _WEIGHT
    preferred = -params.neck_per_s * posture.q_rad[neck]
    preferred[:2] = 0.0
    return solve_rates(dx_dq[1:, neck], wanted, preferred, weights, limits)
