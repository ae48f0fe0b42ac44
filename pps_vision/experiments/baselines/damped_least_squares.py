"""Damped least squares for a point of an arm: baseline of the arm's quadratic program."""

import numpy as np

from control.arm import ArmParams
from control.differential_kinematics import rate_limits
from pps_vision.robot.model import Posture
from pps_vision.types import Array

DAMPING_M = 0.05  # λ in m/rad (Buss 2004 tunes it by hand; 0.01–0.2 tried on development postures)


def damped_least_squares(
    params: ArmParams,
    posture: Posture,
    side: str,
    frame: str,
    point: Array,
    velocity_root: Array,
    rest_rad: Array,
    hold_s: float | None = None,
    damping_m: float = DAMPING_M,
) -> Array:
    """Joint rates (n_joints,) q̇ = Jᵀ(J Jᵀ + λ²)⁻¹ v + (1 − J⁺J) k (rest − q) (Nakamura & Hanafusa 1986; Liégeois 1977).

    All rates are scaled by one factor to the rate limit.  With `hold_s` each joint's rate is then clipped so that the
    joint stays within its limits for that time.
    """
    robot = posture.robot
    columns = robot.indices(robot.names.arm(side))
    q = posture.q_rad[columns]
    J = posture.jacobian(frame, point)[:3, columns]
    inverse: Array = J.T @ np.linalg.inv(J @ J.T + damping_m**2 * np.eye(3))
    preferred = params.posture_per_s * (rest_rad - q)
    rates = inverse @ velocity_root + preferred - inverse @ (J @ preferred)
    rates *= min(1.0, params.max_rate_rad_s / max(float(np.abs(rates).max()), 1e-12))
    if hold_s is not None:
        limits = rate_limits(q, robot.lower_rad[columns], robot.upper_rad[columns], params.max_rate_rad_s, 1 / hold_s)
        rates = np.clip(rates, *limits)
    dq = np.zeros(robot.n_joints)
    dq[columns] = rates
    return dq
