"""Robots with one of R's sources of error, and the trials of a session as a robot that errs measures them."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from learning.pps.joint_offsets import TouchTrial, joint_offsets
from pps_vision.app.encounters.robots import H_S, ErrorSources, MiscalibratedRobot, true_robot
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.types import Array

SOURCES = {
    "CAD model": ("link_m", "link_rad"),
    "joint calibration": ("joint_rad",),
    "backlash, elasticity": ("slack_rad",),
    "taxel poses": ("taxel_m", "taxel_rad"),
    "cameras": ("focal", "principal_px"),
}


def errors_from(*sources: str) -> ErrorSources:
    """Return the named sources at their defaults, all others zero."""
    names = {name for source in sources for name in SOURCES[source]}
    return ErrorSources(**{name: value if name in names else 0.0 for name, value in vars(ErrorSources()).items()})


def observe(robot: MiscalibratedRobot, trial: TouchTrial, by_eyes: bool, rng: np.random.Generator) -> TouchTrial:
    """Return a true trial as a robot measures it.

    Args:
        robot: The robot.
        trial: True joints and object.
        by_eyes: Triangulate the object; otherwise it is the right fingertip, located by the joints.
        rng: Source of the slack of the joints.
    """
    q_true = trial.joints_rad
    q = q_true + robot.reading(rng)
    around = trial.positions[:, None] + H_S * np.array([-1.0, 0.0, 1.0])[:, None] * trial.velocities[:, None]
    points = np.array(
        [
            robot.triangulate(*sample) if by_eyes else _locate_fingertip(robot, *sample)
            for sample in zip(around, q_true, q, strict=True)
        ]
    )
    velocities = (points[:, 2] - points[:, 0]) / (2 * H_S)
    return replace(trial, joints_rad=q, positions=points[:, 1], velocities=velocities)


def _locate_fingertip(erring: MiscalibratedRobot, points: Array, q_true: Array, q: Array) -> Array:
    """Points (k, 3), fixed to the true right fingertip, where the assumed joints place them."""
    robot, _, _ = true_robot()
    tip = robot.names.index_tips[1]
    in_tip = move_points(inverse(robot.at(q_true).T_root(tip)), points)
    return erring.model.at(q).point(tip, in_tip)


def calibrated(robot: MiscalibratedRobot, observed: Iterable[TouchTrial]) -> MiscalibratedRobot:
    """Return the robot with its encoder offsets corrected by an estimate from observed touches."""
    estimate = joint_offsets(robot.model, robot.rig, robot.skin, observed)
    return replace(robot, joint_offsets_rad=robot.joint_offsets_rad + estimate.offsets_rad)
