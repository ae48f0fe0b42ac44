"""Drawn sessions: the touches follow the known probability, and the study on a few robots."""

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw

from pps_vision.experiments.pps.known_sessions import KINDS, KnownSessions, Robot


@pytest.mark.parametrize("kind", ["paths say much", "touches near the taxel", "a fifth lost", "heavy tails"])
def test_touches_come_as_often_as_their_known_probability(kind: str) -> None:
    rng = np.random.default_rng(SEED)
    trials, known = Robot.draw(KINDS[kind], rng).session(2000, rng)
    touched = np.array([trial.touched for trial in trials])
    for low in (0.0, 0.1, 0.3, 0.6):
        held = (known >= low) & (known < low + 0.3)
        error = np.sqrt(np.mean(known[held] * (1 - known[held])) / held.sum())
        assert abs(touched[held].mean() - known[held].mean()) < 4 * error + 0.01


def test_the_study_on_a_few_robots() -> None:
    numbers, charts = run_and_draw(KnownSessions(n=2, seed=SEED))
    assert set(numbers["kinds"]) == set(KINDS)
    assert set(charts) == {""}
    much = numbers["kinds"]["paths say much"]
    assert much["known"][0] < much["ours"][0] < much["base_rate"][0]
