"""Where the eyes meet: the fixation point of a gaze posture, and the posture that fixates a point.

A gaze posture is (neck yaw, neck pitch, vergence) in rad (J, "gaze"); the eyes verge symmetrically
(version 0) and every other joint is 0.  A pitch beyond the neck's own limit stands for the
fixation point it would reach; on the robot the eyes' tilt helps the neck get there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.robot.chain import Chain
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array

_DEG = np.pi / 180


@dataclass(frozen=True)
class GazeLimits:
    """(lower, upper) of each gaze joint in rad; defaults from J."""

    yaw_rad: tuple[float, float] = (-55 * _DEG, 55 * _DEG)
    pitch_rad: tuple[float, float] = (-40 * _DEG, 40 * _DEG)
    vergence_rad: tuple[float, float] = (5 * _DEG, 90 * _DEG)

    def __post_init__(self) -> None:
        if not np.all(self.lower < self.upper) or self.lower[2] <= 0:
            raise ValueError(f"gaze limits {self}: expected lower below upper and vergence above 0")

    @property
    def lower(self) -> Array:
        """(3,) rad."""
        return np.array([self.yaw_rad[0], self.pitch_rad[0], self.vergence_rad[0]])

    @property
    def upper(self) -> Array:
        """(3,) rad."""
        return np.array([self.yaw_rad[1], self.pitch_rad[1], self.vergence_rad[1]])


def fixation_point(posture: Posture) -> Array | None:
    """(3,) root: midpoint of the shortest segment between the optical axes; None where they do
    not meet in front of the eyes."""
    names = posture.robot.names
    left, right = posture.T_root(names.left_eye), posture.T_root(names.right_eye)
    meeting = _meeting_points(left[None, :3, 3], left[None, :3, 2], right[None, :3, 3], right[None, :3, 2])[0]
    return None if np.isnan(meeting[0]) else meeting


def fixated_gaze(posture: Posture, limits: GazeLimits | None = None) -> Array:
    """(3,) rad: the gaze posture that stands for what the eyes fixate, however tilt, version and torso are; NaN where
    the limits forbid it."""
    robot = posture.robot
    q = np.zeros(robot.n_joints)
    index = robot.indices(robot.names.gaze_joints)
    q[index] = posture.q_rad[index]
    point = fixation_point(robot.at(q))
    if point is None:
        return np.full(3, np.nan)
    yaw, pitch, tilt, left, right = q[index]
    return gaze_for_points(robot, point[None], limits, np.array([[yaw, pitch + tilt, left - right]]))[0]


def fixation_points(robot: Robot, gaze_rad: ArrayLike) -> Array:
    """(N, 3) root: fixation points of gaze postures (N, 3); NaN where the axes do not meet."""
    return _FixationModel(robot)(np.asarray(gaze_rad, dtype=float))


def gaze_for_points(
    robot: Robot, points_root: ArrayLike, limits: GazeLimits | None = None, starts_rad: Array | None = None
) -> Array:
    """(N, 3) rad: the gaze postures that fixate points (N, 3); NaN where the limits forbid it.  `starts_rad` (N, 3),
    gaze postures that nearly do, make it quicker."""
    limits = limits or GazeLimits()
    points = np.asarray(points_root, dtype=float)
    model = _FixationModel(robot)

    def forward(gaze: Array) -> tuple[Array, Array]:
        h = 1e-7
        here, *there = model(np.concatenate([gaze, *(gaze + h * axis for axis in np.eye(3))])).reshape(4, -1, 3)
        return here, (np.stack(there, axis=2) - here[:, :, None]) / h

    known = np.all(np.isfinite(points), axis=1)
    starts = np.tile([0.0, 0.0, 20 * _DEG], (len(points), 1)) if starts_rad is None else starts_rad
    solution = solve_ik(
        forward, points[known], starts[None, known], limits.lower, limits.upper, IKParams(tolerance=1e-8, max_steps=30)
    )
    gaze = np.full((len(points), 3), np.nan)
    gaze[known] = np.where(solution.converged[:, None], solution.q_rad, np.nan)
    return gaze


class _FixationModel:
    """gaze (N, 3) -> fixation points (N, 3), the chains read once."""

    def __init__(self, robot: Robot) -> None:
        names = robot.names
        yaw, pitch, _, left_pan, right_pan = names.gaze_joints
        self.left = Chain.of(robot, (yaw, pitch, left_pan), names.left_eye)
        self.right = Chain.of(robot, (yaw, pitch, right_pan), names.right_eye)

    def __call__(self, gaze: Array) -> Array:
        half = np.array([1.0, 1.0, 0.5])
        R_left, c_left = self.left.frames(gaze * half)
        R_right, c_right = self.right.frames(gaze * half * [1, 1, -1])
        return _meeting_points(c_left, R_left[:, :, 2], c_right, R_right[:, :, 2])


def _meeting_points(c_left: Array, a_left: Array, c_right: Array, a_right: Array) -> Array:
    """(N, 3) midpoints of the shortest segments between rays c + s·a (unit a), NaN where the rays
    are parallel or nearest behind an origin."""
    apart = c_right - c_left
    cosine = np.einsum("ni,ni->n", a_left, a_right)
    sine2 = np.sum(np.cross(a_left, a_right) ** 2, axis=1)  # exact where 1 − cos² cancels
    sine2 = np.where(sine2 > 1e-12, sine2, np.nan)
    along_left, along_right = np.einsum("ni,ni->n", apart, a_left), np.einsum("ni,ni->n", apart, a_right)
    s = (along_left - cosine * along_right) / sine2
    t = (cosine * along_left - along_right) / sine2
    meeting = 0.5 * (c_left + s[:, None] * a_left + c_right + t[:, None] * a_right)
    return np.where(((s > 0) & (t > 0))[:, None], meeting, np.nan)
