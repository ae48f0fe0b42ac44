"""Settings that must stand before the packages are imported, the robot at hand, and one seeded generator a test."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# For `from data import shared_data`.  Not tests/ itself: its folders have the packages' names and would hide them.
sys.path[:0] = [str(Path(__file__).parent / name) for name in ("helpers", "robustness")]

settings.register_profile("untimed", deadline=None)  # the machine may be busy
settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def _no_figure_stays_open() -> Iterator[None]:
    """Charts that a test drew and nobody saved."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(scope="session")
def robot():
    from pps_vision.robot.icub import load_icub

    return load_icub()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
