"""The real data nobody here made: found beside the project, or where PPS_VISION_DATA points."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("PPS_VISION_DATA", Path(__file__).parents[2] / "shared" / "data"))


def shared_data(*parts: str) -> Path:
    """A file or folder of the shared data; skips the test, saying so, where it is absent."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no shared data: {Path(*parts)} is not here (PPS_VISION_DATA names the folder)")
    return path
