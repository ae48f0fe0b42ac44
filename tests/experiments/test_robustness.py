"""The study of attacks: what its parts find is counted and shown."""

import pytest

from pps_vision.experiments import robustness
from pps_vision.experiments.adversarial_control import Outcome
from pps_vision.experiments.fuzz_readers import Outcome as Read
from pps_vision.experiments.kills import COUNTS
from pps_vision.experiments.robustness import Robustness
from pps_vision.experiments.tables import markdown


def test_what_is_found_is_counted_and_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robustness, "prepare", lambda folder: None)
    monkeypatch.setattr(robustness, "kill_at_random", lambda command, folder, n, rng: dict.fromkeys(COUNTS, n))
    monkeypatch.setattr(robustness, "fuzz", lambda name, seed, n: Read(n - 4, 3, (f"{name} 7: KeyError",)))
    found = Outcome(steps=90, faults=["seed 1, episode 2: limit left"])
    found.refused.update({"posture": 20, "pipeline": 10})
    monkeypatch.setattr(robustness, "attack", lambda steps, seed: found)
    study = Robustness(n=2, mutants=50, steps=90)
    tables = study.tables(study.run())
    inputs = markdown(tables["inputs"]).splitlines()
    assert "| gaze | 46 | 3 | 1 |" in inputs
    assert inputs[-1] == "| control (frames) | 60 | 30 | 1 |"
    kills = markdown(tables["kills"]).splitlines()
    assert kills[-1] == "| all |" + f" {2 * (len(kills) - 3)} |" * len(COUNTS)
