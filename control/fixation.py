"""Fixate a point with both eyes (J IV.1); the eyes' tilt continues where the neck's pitch ends."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from control.differential_kinematics import rate_limits, solve_rates
from control.head import TILT, HeadLimits, gaze_columns, gaze_of, gaze_range
from control.limits import MAX_HOLD_S, check_times
from pps_vision.errors import InputError
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array, JointVelocity

# Least-squares weights of the rates, in units of the features.  The tilt's is larger, so it moves only where the neck's
# pitch cannot; the price is an error of 0.05² of the tilt's return.
_WEIGHTS = np.array([1e-3, 1e-3, 0.05, 1e-3])


@dataclass(frozen=True)
class FixationParams:
    """Gains and limits of the fixation controller."""

    gain_per_s: float = 8.0  # k of G = k·(∂x/∂q)⁻¹ (J IV.1); stable below 2 by the time between two commands
    tilt_return_per_s: float = 2.0  # rate at which the tilt returns to zero as the neck takes over
    limits: HeadLimits = field(default_factory=HeadLimits)  # range and speed of the head


_WHOLE_STEP = FixationParams(1.0, 1.0, HeadLimits(neck_rad_s=np.pi / 6, eyes_rad_s=np.pi / 6))  # of `gaze_at`


def step(
    params: FixationParams,
    posture: Posture,
    p_root: ArrayLike,
    v_root: ArrayLike = (0.0, 0.0, 0.0),
    hold_s: float = MAX_HOLD_S,
    stamp_s: float = 0.0,
) -> JointVelocity:
    """Head and eye rates q̇ = −G x towards fixation of a point (J IV.1).

    x is [a_L − a_R, mean a, mean b] of the azimuth a and elevation b (rad) of the point in each eye: J's pixel features
    without the lens, linear in the joints also far off axis.  `p_root` (3,) m is the target's position
    at `stamp_s`, `v_root` (3,) m/s its velocity, fed forward.  The rates may be held for `hold_s`: no joint leaves its
    limits meanwhile.  InputError for a target that is not finite, a stamp that is not, or `hold_s` out of (0, 0.5].
    """
    check_times("fixation", stamp_s, hold_s)
    return JointVelocity(stamp_s, _rates(params, posture, *checked_target(p_root, v_root), hold_s), hold_s)


def checked_target(p_root: ArrayLike, v_root: ArrayLike) -> tuple[Array, Array]:
    """A target's position (3,) and velocity (3,); InputError unless both are finite."""
    p = np.asarray(p_root, dtype=float)
    v = np.asarray(v_root, dtype=float)
    if p.shape != (3,) or v.shape != (3,) or not np.all(np.isfinite([p, v])):
        raise InputError("fixation", f"target at {p} moving {v}; expected a known point and velocity (3,)")
    return p, v


def _rates(params: FixationParams, posture: Posture, p: Array, v: Array, hold_s: float) -> Array:
    """Joint rates (n_joints,) of `step`."""
    gaze = gaze_of(posture)
    columns = gaze_columns(posture.robot)
    x, dx_dq, dx_dp = features(posture, p)
    lower, upper = gaze_range(params.limits.gaze, posture)
    rate_range = rate_limits(gaze, lower, upper, params.limits.max_rate, 1 / hold_s)
    preferred = np.zeros(4)
    preferred[TILT] = -params.tilt_return_per_s * gaze[TILT]
    rates = solve_rates(dx_dq @ columns, -params.gain_per_s * x - dx_dp @ v, preferred, _WEIGHTS, rate_range)
    return np.asarray(columns @ rates)


def features(posture: Posture, p_root: Array) -> tuple[Array, Array, Array]:
    """x (3,) of a root point, ∂x/∂q (3, n_joints) and ∂x/∂p (3, 3): the interaction matrices."""
    names = posture.robot.names
    left, right = (np.column_stack(_direction(posture, eye, p_root)) for eye in (names.left_eye, names.right_eye))
    rows = np.vstack([left[0] - right[0], 0.5 * (left + right)])
    return rows[:, 0], rows[:, 1:-3], rows[:, -3:]


def _direction(posture: Posture, eye: str, p_root: Array) -> tuple[Array, Array, Array]:
    """Azimuth and elevation (2,) of a point in an eye, with their derivatives by q and by p_root."""
    T = posture.T_root(eye)
    X, Y, Z = at = (p_root - T[:3, 3]) @ T[:3, :3]
    rho2 = max(X * X + Z * Z, 1e-12)
    rho = np.sqrt(rho2)
    r2 = rho2 + Y * Y
    d_at = np.array([[Z / rho2, 0.0, -X / rho2], [-X * Y / (rho * r2), rho / r2, -Z * Y / (rho * r2)]])
    d_dp = d_at @ T[:3, :3].T
    # a joint moves a point fixed to the eye by J dq, so the target by −J dq relative to the eye
    d_dq = -d_dp @ posture.jacobian(eye, at)[:3]
    return np.array([np.arctan2(X, Z), np.arctan2(Y, rho)]), d_dq, d_dp


def fixation_error(posture: Posture, p_root: ArrayLike) -> float:
    """The larger of the two angles (rad) between an eye's optical axis and the direction of the point."""
    errors = []
    for eye in (posture.robot.names.left_eye, posture.robot.names.right_eye):
        T = posture.T_root(eye)
        direction = np.asarray(p_root, dtype=float) - T[:3, 3]
        axis = T[:3, 2]
        errors.append(np.arctan2(np.linalg.norm(np.cross(axis, direction)), axis @ direction))
    return float(max(errors))


def gaze_at(robot: Robot, q_rad: ArrayLike, p_root: ArrayLike) -> Array:
    """The configuration (n_joints,) whose eyes fixate a point, or come as near as their limits allow.

    The same control law, iterated from `q_rad` until it rests; of fixed cameras `q_rad` itself.
    """
    q = np.array(q_rad, dtype=float)
    p = np.asarray(p_root, dtype=float)
    for _ in range(60 if robot.names.gaze_joints else 0):
        dq = _rates(_WHOLE_STEP, robot.at(q), p, np.zeros(3), 1.0)
        q += dq
        if np.abs(dq).max() < 1e-9:
            break
    return q
