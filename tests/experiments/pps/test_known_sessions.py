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


def test_what_misses_its_goal_is_bold() -> None:
    """Below the base rate by 10 % where paths say anything; 90 ± 5 % of the intervals hold."""

    def measured(gain: float, coverage: float) -> dict[str, list[float]]:
        scores = {key: [0.1, 0.1, 0.1] for key in ("ours", "base_rate", "known")}
        return {**scores, "percent_below": [gain, gain - 1, gain + 1], "coverage": [coverage] * 3}

    kinds = {
        "paths say nothing": measured(-1, 95.4),
        "paths say little": measured(9.9, 85),
        "heavy tails": measured(10, 84),
    }
    rows = [row[4:] for row in KnownSessions().tables({"kinds": kinds})[""].rows]
    assert rows == [
        ["-1 (-2–0)", "–", "**95.4 (95.4–95.4)**", "85–95"],
        ["**9.9 (8.9–10.9)**", "≥ 10", "85 (85–85)", "85–95"],
        ["10 (9–11)", "≥ 10", "**84 (84–84)**", "85–95"],
    ]
