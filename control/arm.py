"""Move points of an arm at Cartesian velocities: a quadratic programme within joint limits and clear of the body."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from control.differential_kinematics import rate_limits, solve_rates
from control.limits import MAX_HOLD_S
from pps_vision.errors import InputError
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array

_DEG = np.pi / 180


@dataclass(frozen=True)
class ArmParams:
    """Limits and damping of an arm's joint rates."""

    max_rate_rad_s: float = 60 * _DEG  # rate limit of each joint
    damping_m: float = 0.003  # damping that keeps rates finite at singular postures
    posture_per_s: float = 1.0  # rate at which joints that the task does not need return to the rest posture
    clearance_m: float = 0.025
    """Smallest self-collision distance that the arm approaches; above that of `LimitParams`, which stops it."""
    resting: int = 0  # number of the arm's last joints that stay at rest (R: 3, the wrist)
    near_m: float = 0.1  # bodies farther apart than this are ignored


class MovingPoint(NamedTuple):
    """A point of the arm and its commanded velocity."""

    frame: str  # name of the frame that carries it
    point: ArrayLike  # (3,) m in `frame`
    velocity_root: ArrayLike  # (3,) m/s
    weight: float = 1.0  # weight of its squared error
    free_across: bool = False  # whether only the speed along `velocity_root` counts; the motion across is free


@dataclass(frozen=True)
class KeepIn:
    """A sphere that the origin of a frame must not leave."""

    frame: str  # name of the frame
    center_root: Array  # (3,) m
    radius_m: float  # radius of the sphere
    approach_per_s: float = 5.0  # largest rate of approach to the surface, per distance from it

    def row(self, posture: Posture, columns: list[int]) -> tuple[Array, float]:
        """The frame's outward speed per joint rate (k,) m/rad, and the largest one allowed (m/s)."""
        offset = posture.point(self.frame) - self.center_root
        distance = float(np.linalg.norm(offset))
        outward = offset / max(distance, 1e-9)
        return outward @ posture.jacobian(self.frame)[:3, columns], self.approach_per_s * (self.radius_m - distance)


class ArmConstraints(NamedTuple):
    """Constraints of the rates of an arm's k joints in one control step."""

    columns: list[int]  # where the joints are in the configuration vector
    limits: tuple[Array, Array]  # lowest and highest rates (k,), rad/s
    preferred: Array  # (k,) rad/s towards the rest posture, for joints that the task does not need
    rows: Array  # (m, k) inequalities: rows @ rates ≤ most
    most: Array  # (m,) their right sides


def arm_constraints(
    params: ArmParams,
    posture: Posture,
    side: str,
    rest_rad: ArrayLike,
    keep_in: KeepIn | None = None,
    hold_s: float = MAX_HOLD_S,
    self_collision: SelfCollision | None = None,
    more_rows: tuple[Array, Array] | None = None,
) -> ArmConstraints:
    """Constraints of the joint rates of the arm of one `side`, whose rest posture is `rest_rad` (k,).

    The rates may be held for `hold_s`: no joint leaves its limits meanwhile.  A frame stays in the sphere `keep_in`,
    the arm clear of the robot's bodies; `more_rows` are further constraints, rows (m, n_joints) @ rates ≤ most (m,).
    """
    robot = posture.robot
    columns = robot.indices(robot.names.arm(side))
    q = posture.q_rad[columns]
    limits = rate_limits(q, robot.lower_rad[columns], robot.upper_rad[columns], params.max_rate_rad_s, 1 / hold_s)
    for limit in limits:
        limit[len(columns) - params.resting :] = 0.0
    rows: Array = np.empty((0, len(columns)))
    most: Array = np.empty(0)
    if self_collision is not None:
        distance, parting = self_collision.parting(posture.q_rad, params.near_m, columns)
        rows = -parting
        most = (distance - params.clearance_m) / hold_s
    if keep_in is not None:
        outward, max_m_s = keep_in.row(posture, columns)
        rows = np.vstack([rows, outward])
        most = np.append(most, max_m_s)
    if more_rows is not None:
        rows = np.vstack([rows, more_rows[0][:, columns]])
        most = np.concatenate([most, more_rows[1]])
    preferred = params.posture_per_s * (np.asarray(rest_rad, dtype=float) - q)
    return ArmConstraints(columns, limits, preferred, rows, most)


def arm_velocity(
    params: ArmParams,
    posture: Posture,
    bounds: ArmConstraints,
    points: Sequence[MovingPoint],
    jacobians: Sequence[Array] | None = None,
) -> Array:
    """Joint rates (n_joints,) whose points' velocities are nearest to those commanded, by least squares.

    Where a constraint forbids the motion, the points slide along it, or stop.  `jacobians` (3, n_joints) of the points,
    if they are known already.  InputError unless velocities are finite.
    """
    J: list[Array] = []
    velocities: list[Array] = []
    jacobians = jacobians or [posture.jacobian(point.frame, point.point)[:3] for point in points]
    for point, of_point in zip(points, jacobians, strict=True):
        velocity = np.asarray(point.velocity_root, dtype=float)
        if velocity.shape != (3,) or not np.all(np.isfinite(velocity)):
            raise InputError("arm", f"velocity {velocity} of {point.frame}; expected three finite numbers in m/s")
        jacobian = of_point[:, bounds.columns]
        if point.free_across:
            speed = float(np.linalg.norm(velocity))
            jacobian = (velocity / max(speed, 1e-9))[None] @ jacobian
            velocity = np.array([speed])
        J.append(np.sqrt(point.weight) * jacobian)
        velocities.append(np.sqrt(point.weight) * velocity)
    columns, limits, preferred, rows, most = bounds
    dq = np.zeros(posture.robot.n_joints)
    task = np.concatenate(J), np.concatenate(velocities)
    dq[columns] = solve_rates(*task, preferred, params.damping_m, limits, rows, most)
    return dq
