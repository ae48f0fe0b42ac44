"""Rates, sessions and the search for parameters of the encounters' study."""

import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import EncounterScene
from pps_vision.app.encounters.registry import BASELINES
from pps_vision.app.encounters.training import learn
from pps_vision.app.encounters.tuned import TUNED
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters.sessions import session


@pytest.fixture(scope="module")
def scene() -> EncounterScene:
    return EncounterScene()


def test_tuned_parameters_are_those_of_the_tuning_study() -> None:
    file = Path(__file__).parents[2] / "docs" / "results" / "encounters.json"
    best = {name: of for name, of in json.loads(file.read_text())["tuning"]["best"].items() if name in BASELINES}
    assert {name: {k: v for k, v in of.items() if k != "score"} for name, of in best.items()} == TUNED
    for name, baseline in BASELINES.items():
        assert all(low <= TUNED[name][k] <= high for k, (low, high) in baseline.ranges.items())


@pytest.mark.parametrize("name", ["ours, wrist at rest", "distance only"])
def test_a_session_shows_the_activations_that_move_the_arm(scene: EncounterScene, name: str) -> None:
    """One approach: the arm begins to move after a shown activation has exceeded the threshold; ours stays on the path
    that is kept."""
    memories = {side: learn(scene, side, 3, share=0.05) for side in get_args(Side)[:1]}
    numbers = session(scene, memories, "stop", name, 0.1, 3)
    (shown,) = numbers["frames"]["left"]
    first = int(np.argmax(np.array(shown["speed_m_s"]) > 1e-3))
    above = int(np.argmax(np.array(shown["activations"]).max(axis=1) > TUNED["distance only"]["threshold"]))
    delay_s = shown["t_s"][first] - shown["t_s"][above]
    if name == "distance only":
        assert delay_s == pytest.approx(TUNED[name]["confirmation_s"], abs=0.051)
        assert numbers["paths_mm"] == {}
        return
    assert 0 <= delay_s < 0.5, "until the object has come nearer"
    (path,) = numbers["paths_mm"]["left"]
    low, high = numbers["arms"]["left"]["palm_m"]
    assert len(path) >= 3
    assert np.all((np.array(path) >= 1000 * np.array(low) - 1) & (np.array(path) <= 1000 * np.array(high) + 1))
