"""One robot, and what its left skin learned from a few approaches."""

import pytest

from pps_vision.app.encounters.encounter import EncounterScene
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import Side


@pytest.fixture(scope="session")
def scene() -> EncounterScene:
    return EncounterScene()


@pytest.fixture(scope="session")
def memories(scene: EncounterScene) -> dict[Side, Memories]:
    return {"left": learn(scene, "left", 3, share=0.1)}
