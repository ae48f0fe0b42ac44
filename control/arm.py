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
    """How the arm's joints move."""

    max_rate_rad_s: float = 60 * _DEG
    """Rate limit of each joint."""
    damping_m: float = 0.003
    """Damping that keeps rates finite at singular postures."""
    posture_per_s: float = 1.0
    """Rate at which the joints that the task leaves free return to the rest posture."""
    clearance_m: float = 0.025
    """Self-collision distance that the arm approaches no further; above that of `LimitParams`, which stops it."""
    resting: int = 0
    """How many of the arm's last joints stay at rest (R: 3, the wrist)."""
    near_m: float = 0.1
    """Bodies farther apart than this are not looked at."""


class MovingPoint(NamedTuple):
    """A point of the arm that is to move."""

    frame: str
    """Name of the frame that carries it."""
    point: ArrayLike
    """(3,) m in `frame`."""
    velocity_root: ArrayLike
    """(3,) m/s."""
    weight: float = 1.0
    """How much its error counts beside that of other points."""
    free_across: bool = False
    """Whether only its speed along `velocity_root` counts, and it may move across as it likes."""


@dataclass(frozen=True)
class KeepIn:
    """A sphere that the origin of a frame must not leave."""

    frame: str
    """Name of the frame."""
    center_root: Array
    """(3,) m."""
    radius_m: float
    """Radius of the sphere."""
    approach_per_s: float = 5.0
    """The origin nears the surface no faster than this times the distance left."""

    def row(self, posture: Posture, columns: list[int]) -> tuple[Array, float]:
        """The frame's outward speed per joint rate (k,) m/rad, and the largest one allowed (m/s)."""
        offset = posture.point(self.frame) - self.center_root
        distance = float(np.linalg.norm(offset))
        outward = offset / max(distance, 1e-9)
        return outward @ posture.jacobian(self.frame)[:3, columns], self.approach_per_s * (self.radius_m - distance)


class ArmConstraints(NamedTuple):
    """What the rates of an arm's k joints obey in one frame, whatever its points are to do."""

    columns: list[int]
    """Where the joints are in the configuration vector."""
    limits: tuple[Array, Array]
    """Lowest and highest rates (k,), rad/s."""
    preferred: Array
    """(k,) rad/s towards the rest posture, where the task leaves joints free."""
    rows: Array
    """(m, k) inequalities: rows @ rates ≤ most."""
    most: Array
    """(m,) their right sides."""


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
    """What the joint rates of the arm of `side` obey in one frame.

    `rest_rad` (k,) is the arm's rest posture.  Joint limits are kept for the time `hold_s` for which the rates may be
    held; the arm keeps clear of the other bodies of `self_collision`, if there is one, and its rates obey `more_rows`:
    rows (m, n_joints) @ rates ≤ most (m,).
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
        rows, most = -parting, (distance - params.clearance_m) / hold_s
    if keep_in is not None:
        outward, max_m_s = keep_in.row(posture, columns)
        rows, most = np.vstack([rows, outward]), np.append(most, max_m_s)
    if more_rows is not None:
        rows, most = np.vstack([rows, more_rows[0][:, columns]]), np.concatenate([most, more_rows[1]])
    preferred = params.posture_per_s * (np.asarray(rest_rad, dtype=float) - q)
    return ArmConstraints(columns, limits, preferred, rows, most)


def arm_velocity(
    params: ArmParams, posture: Posture, constraints: ArmConstraints, points: Sequence[MovingPoint]
) -> Array:
    """Joint rates (n_joints,) that move `points` of an arm as they are to, by least squares.

    Where a constraint forbids the motion, the points slide along it, or stop.  InputError for a velocity that is not
    finite.
    """
    J: list[Array] = []
    wanted: list[Array] = []
    for one in points:
        velocity = np.asarray(one.velocity_root, dtype=float)
        if velocity.shape != (3,) or not np.all(np.isfinite(velocity)):
            raise InputError("arm", f"velocity {velocity} of {one.frame}; expected three finite numbers in m/s")
        weight, speed = np.sqrt(one.weight), float(np.linalg.norm(velocity))
        moves = posture.jacobian(one.frame, one.point)[:3, constraints.columns]
        if one.free_across:
            moves, velocity = (velocity / max(speed, 1e-9))[None] @ moves, np.array([speed])
        J.append(weight * moves)
        wanted.append(weight * velocity)
    dq = np.zeros(posture.robot.n_joints)
    columns, limits, preferred, rows, most = constraints
    task = np.concatenate(J), np.concatenate(wanted)
    dq[columns] = solve_rates(*task, preferred, params.damping_m, limits, rows, most)
    return dq
