"""A robot that looks at the space before its left forearm, with and without the lenses' distortion."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE, home, icub_rig, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array

STRAIGHT = (0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="session")
def rig(robot: Robot) -> StereoRig:
    return icub_rig(robot)


@pytest.fixture(scope="session")
def straight_rig(robot: Robot) -> StereoRig:
    """The same eyes behind perfect lenses."""
    return icub_rig(robot, replace(LEFT_EYE, distortion=STRAIGHT), replace(RIGHT_EYE, distortion=STRAIGHT))


@pytest.fixture(scope="session")
def q(robot: Robot) -> Array:
    """Arms at home; both eyes look down at the space before the left arm."""
    down = {"pitch": np.deg2rad(-25.0), "tilt": np.deg2rad(-20.0)}
    return set_gaze(robot, home(robot), yaw=np.deg2rad(18.0), vergence=np.deg2rad(12.0), **down)
