"""The robot's eyes, and one seeded generator a test."""

import sys
from pathlib import Path

import numpy as np
import pytest

from pps_vision.geometry.camera import StereoRig, StereoView
from pps_vision.robot.icub import home, icub_rig
from pps_vision.robot.model import Robot

sys.path.insert(0, str(Path(__file__).parent))  # for `from linear_model import …`


@pytest.fixture(scope="session")
def rig(robot: Robot) -> StereoRig:
    return icub_rig(robot)


@pytest.fixture(scope="session")
def view(robot: Robot, rig: StereoRig) -> StereoView:
    """Both eyes at the home posture."""
    return rig.view(home(robot))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)
