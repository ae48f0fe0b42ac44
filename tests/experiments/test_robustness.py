"""The study of attacks: what its parts find is counted and shown, and kept when it is interrupted."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from pps_vision.experiments import robustness
from pps_vision.experiments.adversarial_control import Outcome
from pps_vision.experiments.fuzz_readers import Outcome as Read
from pps_vision.experiments.kills import COUNTS
from pps_vision.experiments.robustness import Robustness
from pps_vision.experiments.tables import markdown


@pytest.fixture(autouse=True)
def attacked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[list[int]]:
    """The parts, replaced; the first episodes of those of the control."""
    first: list[int] = []

    def attack(steps: int, seed: int, episode_steps: int, number: int) -> Outcome:
        first.append(number)
        found = Outcome(steps=steps, faults=[f"seed {seed}, episode {number}: limit left"])
        found.refused.update({"posture": 20, "pipeline": 10})
        return found

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(robustness, "prepare", lambda folder, commands: None)
    monkeypatch.setattr(robustness, "kill_at_random", lambda command, folder, n, rng: dict.fromkeys(COUNTS, n))
    monkeypatch.setattr(robustness, "fuzz", lambda name, seed, n: Read(n - 4, 3, (f"{name} 7: KeyError",)))
    monkeypatch.setattr(robustness, "attack", attack)
    yield first
    assert list(tmp_path.iterdir()) == []


def test_what_is_found_is_counted_and_shown(attacked: list[int]) -> None:
    study = Robustness(n=2, mutants=50, steps=40_090)
    tables = study.tables(study.run())
    inputs = markdown(tables["inputs"]).splitlines()
    assert "| gaze | 46 | 3 | 1 |" in inputs
    assert inputs[-1] == "| control (frames) | 40000 | 90 | 3 |"
    kills = markdown(tables["kills"]).splitlines()
    assert kills[-1] == "| all |" + f" {2 * (len(kills) - 3)} |" * len(COUNTS)
    assert attacked == [0, 50, 100]


def test_an_interrupted_run_of_the_same_parameters_goes_on(
    monkeypatch: pytest.MonkeyPatch, attacked: list[int]
) -> None:
    study, whole = Robustness(steps=60_000), robustness.attack

    def interrupted(steps: int, seed: int, episode_steps: int, first: int) -> Outcome:
        if first == 100:
            raise KeyboardInterrupt
        return whole(steps, seed, episode_steps, first)

    monkeypatch.setattr(robustness, "attack", interrupted)
    with pytest.raises(KeyboardInterrupt):
        study.run()
    assert attacked == [0, 50]
    monkeypatch.setattr(robustness, "attack", whole)
    Robustness(steps=20_000).run()
    assert attacked == [0, 50, 0]
    assert study.run()["control"]["steps"] == 60_000
    assert attacked == [0, 50, 0, 100]
