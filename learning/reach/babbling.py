"""Motor babbling: random arm postures and the gaze postures that fixate the hand (J IV C)."""

from dataclasses import dataclass

import numpy as np

from learning.reach.params import ArmLimits
from pps_vision.robot.gaze import GazeLimits, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array


@dataclass(frozen=True)
class SeenHand:
    """The hand as the eyes saw it, the torso upright."""

    arm_rad: Array  # (N, 4)
    positions: Array  # (N, 3) m, root frame
    covs: Array  # (N, 3, 3) m²


def random_arms(n: int, rng: np.random.Generator, limits: ArmLimits | None = None) -> Array:
    """(n, 4) rad: postures uniform within the limits."""
    limits = limits or ArmLimits()
    return rng.uniform(limits.lower_rad, limits.upper_rad, (n, len(limits.lower_rad)))


def gaze_at_hand(robot: Robot, side: str, arm_rad: Array, limits: GazeLimits | None = None) -> Array:
    """(N, 3) rad: the gaze postures that by kinematics fixate the hand of arm postures (N, 4); NaN where the limits
    forbid it.  ValueError for an unknown side."""
    palm = robot.names.palm(side)
    hands = robot.chain(robot.names.arm(side)[: arm_rad.shape[1]], palm).positions(arm_rad)[0]
    return gaze_for_points(robot, hands, limits)
