"""The head as a gaze: neck yaw, neck pitch, eyes tilt, vergence.

The eyes' version and the neck's roll stay where they are (J moves neither).
"""

from dataclasses import dataclass, field

import numpy as np

from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array

YAW, PITCH, TILT, VERGENCE = range(4)
_DEG = np.pi / 180


@dataclass(frozen=True)
class HeadLimits:
    """Range and speed of the head."""

    gaze: GazeLimits = field(default_factory=GazeLimits)  # J's gaze range; the robot's own limits narrow it
    neck_rad_s: float = 60 * _DEG  # rate limit of each neck joint
    eyes_rad_s: float = 180 * _DEG  # rate limit of each eye joint

    @property
    def max_rate(self) -> Array:
        """(4,) rad/s; both eyes turn, so vergence changes twice as fast as one of them."""
        return np.array([self.neck_rad_s, self.neck_rad_s, self.eyes_rad_s, 2 * self.eyes_rad_s])


def gaze_of(posture: Posture) -> Array:
    """(4,) neck yaw, neck pitch, eyes tilt, vergence, rad."""
    yaw, pitch, tilt, left, right = posture.q_rad[posture.robot.indices(posture.robot.names.gaze_joints)]
    return np.array([yaw, pitch, tilt, left - right])


def gaze_range(limits: GazeLimits, posture: Posture) -> tuple[Array, Array]:
    """Lower and upper (4,) rad of the gaze at the present version: `limits`, as far as the robot's own allow.

    With a version beyond the eyes' limits, where any vergence turns one of the eyes outwards, the vergence stays.
    """
    robot = posture.robot
    index = robot.indices(robot.names.gaze_joints)
    low = robot.lower_rad[index]
    high = robot.upper_rad[index]
    left, right = posture.q_rad[index[3:]]
    version = 0.5 * (left + right)
    vergence = 2 * max(low[3] - version, version - high[4]), 2 * min(high[3] - version, version - low[4])
    if vergence[0] > vergence[1]:
        vergence = (left - right, left - right)
    lower = np.array([*low[:3], vergence[0]])
    upper = np.array([*high[:3], vergence[1]])
    limited = [YAW, PITCH, VERGENCE]  # J has no tilt
    of_j = np.clip([limits.lower, limits.upper], lower[limited], upper[limited])
    lower[limited], upper[limited] = of_j
    return lower, upper


def gaze_columns(robot: Robot) -> Array:
    """(n_joints, 4) derivatives of the joints by the gaze: dq = gaze_columns @ d(gaze)."""
    columns = np.zeros((robot.n_joints, 4))
    yaw, pitch, tilt, left, right = robot.indices(robot.names.gaze_joints)
    columns[yaw, YAW] = columns[pitch, PITCH] = columns[tilt, TILT] = 1.0
    columns[left, VERGENCE] = 0.5
    columns[right, VERGENCE] = -0.5
    return columns


def carried_velocity(posture: Posture, p_root: Array, dq_rad_s: Array) -> Array:
    """(3,) m/s velocity of a point `p_root` that moves with the trunk, whose joints turn at `dq_rad_s` (n_joints,).

    Relative to the eyes, which the trunk carries, an object at rest moves at the opposite velocity: gaze control
    compensates for the trunk if this velocity is subtracted from the object's.
    """
    robot = posture.robot
    eye = robot.names.left_eye
    moving = robot.moving(eye)
    index = robot.indices(moving[: min(moving.index(joint) for joint in robot.names.gaze_joints[:2])])
    T = posture.T_root(eye)
    J: Array = posture.jacobian(eye, (p_root - T[:3, 3]) @ T[:3, :3])[:3, index]
    return J @ dq_rad_s[index]
