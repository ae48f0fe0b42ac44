"""Motor babbling by kinematics, and gaze postures as points (J IV C)."""

from dataclasses import dataclass

import numpy as np

from learning.reach.babbling import gaze_at_hand, random_arms
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.model import Robot
from pps_vision.types import Array


@dataclass(frozen=True)
class Babbled:
    """Postures whose hand was fixated."""

    arm_rad: Array  # (N, 4)
    gaze_rad: Array  # (N, 3)
    n_tried: int  # number of arm postures tried, fixated or not


def babble(robot: Robot, n: int, rng: np.random.Generator, gaze_limits: GazeLimits | None = None) -> Babbled:
    """Try `n` postures of the right arm's first four joints, uniform within J's limits, and keep those whose hand
    (origin of the palm frame) the eyes can fixate within the limits of the gaze, by kinematics."""
    arm = random_arms(n, rng)
    gaze = gaze_at_hand(robot, "right", arm, gaze_limits)
    fixated = np.isfinite(gaze).all(axis=1)
    return Babbled(arm[fixated], gaze[fixated], n)


def crossing(gaze_rad: Array) -> Array:
    """(N, 3) where the lines of sight of eyes one unit apart cross, a smoother function of the arm than the angles."""
    yaw, pitch, vergence = gaze_rad.T
    ahead = np.cos(yaw)
    ray = np.stack([np.sin(yaw), ahead * np.sin(pitch), ahead * np.cos(pitch)], axis=1)
    return np.asarray(0.5 / np.tan(vergence / 2)[:, None] * ray)


def gaze_at(place: Array) -> Array:
    """(N, 3) rad: the inverse of `crossing`."""
    x, y, z = place.T
    ahead = np.hypot(y, z)
    return np.stack([np.arctan2(x, ahead), np.arctan2(y, z), 2 * np.arctan2(0.5, np.hypot(x, ahead))], axis=1)
