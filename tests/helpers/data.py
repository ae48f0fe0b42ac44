"""What tests are given: real data nobody here made, an arm of seven joints, and the seed of measurements."""

import os
from pathlib import Path

import pytest

SEED = int(os.environ.get("PPS_VISION_SEED", "2016"))  # seed of the tests that measure: any other must do as well
ARM7 = Path(__file__).parents[1] / "arm7" / "robot.toml"
DATA = Path(os.environ.get("PPS_VISION_DATA", Path(__file__).parents[3] / "shared" / "data"))
HAS_PHOTOGRAPHS = (DATA / "rubberwhale").exists()
"""Without them films have procedural walls, before which some limits are wider."""


def shared_data(*parts: str) -> Path:
    """A file or folder of the shared data; skips the test, saying so, where it is absent."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no shared data: {Path(*parts)} is not here (PPS_VISION_DATA names the folder)")
    return path
