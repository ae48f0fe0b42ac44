"""Move any point of an arm at a Cartesian velocity: damped least squares within the joint limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from control.rates import rate_bounds, solve_rates
from pps_vision.robot.model import Posture
from pps_vision.types import Array

_DEG = np.pi / 180


@dataclass(frozen=True)
class ArmParams:
    """`max_rate_rad_s` limits each joint; a joint nears its end no faster than `approach_per_s`
    times what is left; `damping_m` keeps rates finite at singular postures; `posture_per_s`
    pulls what the task leaves free towards the rest posture."""

    max_rate_rad_s: float = 60 * _DEG
    approach_per_s: float = 5.0
    damping_m: float = 0.003
    posture_per_s: float = 1.0


@dataclass(frozen=True)
class KeepIn:
    """A sphere that a frame's origin is not to leave."""

    frame: str
    center_root: Array
    radius_m: float
    approach_per_s: float = 5.0

    def row(self, posture: Posture, columns: list[int]) -> tuple[Array, float]:
        """The frame's outward speed per joint rate (k,), and the most of it allowed (m/s)."""
        offset = posture.point(self.frame) - self.center_root
        distance = float(np.linalg.norm(offset))
        outward = offset / max(distance, 1e-9)
        return outward @ posture.jacobian(self.frame)[:3, columns], self.approach_per_s * (self.radius_m - distance)


def arm_velocity(
    params: ArmParams,
    posture: Posture,
    side: str,
    frame: str,
    point: ArrayLike,
    velocity_root: ArrayLike,
    rest_rad: ArrayLike,
    keep_in: KeepIn | None = None,
) -> Array:
    """Joint rates (n_joints,) that move a `point` (3,) of `frame` at `velocity_root` (3,) m/s.

    Only the arm of `side` moves.  `rest_rad` is the arm's rest posture (k,).  Where a joint's
    limit or the sphere forbids the motion, the point slides along it, or stops.  ValueError for
    a velocity that is not finite.
    """
    velocity = np.asarray(velocity_root, dtype=float)
    if velocity.shape != (3,) or not np.all(np.isfinite(velocity)):
        raise ValueError(f"velocity {velocity} of {frame}: expected three finite numbers in m/s")
    robot = posture.robot
    columns = robot.indices(robot.names.arm(side))
    q = posture.q_rad[columns]
    bounds = rate_bounds(
        q, robot.lower_rad[columns], robot.upper_rad[columns], params.max_rate_rad_s, params.approach_per_s
    )
    preferred = params.posture_per_s * (np.asarray(rest_rad, dtype=float) - q)
    J = posture.jacobian(frame, point)[:3, columns]
    rates = solve_rates(J, velocity, preferred, params.damping_m, bounds)
    if keep_in is not None:
        outward, most = keep_in.row(posture, columns)
        if outward @ rates > most:
            hard = 30.0  # the sphere's row outweighs the task's a thousandfold in the squares
            rates = solve_rates(
                np.vstack([J, hard * outward]), np.append(velocity, hard * most), preferred, params.damping_m, bounds
            )
    dq = np.zeros(robot.n_joints)
    dq[columns] = rates
    return dq
