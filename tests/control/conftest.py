"""The robot at hand, and one seeded generator a test."""

import numpy as np
import pytest

from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_icub()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
