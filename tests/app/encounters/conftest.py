"""One robot, and what its left skin learned from a few approaches."""

import pytest

from pps_vision.app.encounters.encounter import Arena
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import Side


@pytest.fixture(scope="session")
def arena() -> Arena:
    return Arena()


@pytest.fixture(scope="session")
def memories(arena: Arena) -> dict[Side, Memories]:
    return {"left": learn(arena, "left", 3, share=0.1)}
