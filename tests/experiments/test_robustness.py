"""The studies of attacks: what their parts find is counted and shown, and kept when they are interrupted."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from pps_vision.experiments import adversarial_control, robustness
from pps_vision.experiments.adversarial_control import AdversarialControl, Outcome
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
        found = Outcome(steps=steps, faults=[f"seed {seed}, episode {number}: limit left"], freed=3)
        found.refused.update({"posture": 20, "pipeline": 10})
        found.smallest_distance_mm = 20.0 + number
        return found

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(robustness, "prepare", lambda folder, commands: None)
    monkeypatch.setattr(robustness, "kill_at_random", lambda command, folder, n, rng: dict.fromkeys(COUNTS, n))
    monkeypatch.setattr(robustness, "fuzz", lambda name, seed, n: Read(n - 4, 3, (f"{name} 7: KeyError",)))
    monkeypatch.setattr(adversarial_control, "attack", attack)
    yield first
    assert list(tmp_path.iterdir()) == []


def test_what_is_found_is_counted_and_shown() -> None:
    study = Robustness(n=2, n_batch=3, mutants=50)
    tables = study.tables(study.run())
    assert "| gaze | 46 | 3 | 1 |" in markdown(tables["inputs"]).splitlines()
    kills = markdown(tables["kills"]).splitlines()
    assert kills[-1] == "| all |" + f" {2 * (len(kills) - 4) + 3} |" * len(COUNTS)


def test_the_parts_of_the_control_are_added_up(attacked: list[int]) -> None:
    study = AdversarialControl(steps=40_090)
    row = markdown(study.tables(study.run())[""]).splitlines()[-1]
    assert row == "| 40000 | 90 | 3 | 0.019 % / 7.7 % | 20.00 | 9 |", "7.75 of 40 090 frames and of 101 episodes"
    assert attacked == [0, 50, 100]


def test_an_interrupted_run_of_the_same_parameters_goes_on(
    monkeypatch: pytest.MonkeyPatch, attacked: list[int]
) -> None:
    study, whole = AdversarialControl(steps=60_000), adversarial_control.attack

    def interrupted(steps: int, seed: int, episode_steps: int, first: int) -> Outcome:
        if first == 100:
            raise KeyboardInterrupt
        return whole(steps, seed, episode_steps, first)

    monkeypatch.setattr(adversarial_control, "attack", interrupted)
    with pytest.raises(KeyboardInterrupt):
        study.run()
    assert attacked == [0, 50]
    monkeypatch.setattr(adversarial_control, "attack", whole)
    AdversarialControl(steps=20_000).run()
    assert attacked == [0, 50, 0]
    assert study.run()["steps"] == 60_000
    assert attacked == [0, 50, 0, 100]
