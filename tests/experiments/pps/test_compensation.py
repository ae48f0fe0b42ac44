"""Compensation: each case is trained and tested on its own trials, and the scores are drawn."""

import pytest

from pps_vision.experiments.pps import compensation
from pps_vision.experiments.pps.compensation import WAYS, Compensation
from pps_vision.experiments.pps.errors import SOURCES
from pps_vision.experiments.pps.lives import CASES


def test_each_case_learns_from_and_meets_its_own() -> None:
    lives = ("taught without", "tested without"), ("taught with", "tested with"), ("taught better", "tested better")
    assert compensation._by_case(*lives) == {  # type: ignore[arg-type]
        "no errors": lives[0],
        "before learning": ("taught without", "tested with"),
        "map learned anew": lives[1],
        "joints learned too": lives[2],
    }


def test_scores_are_drawn() -> None:
    score = {case: {"auroc": 0.9, "brier": 0.1} for case in CASES}
    off = {"error_mm": 10.0, "error_left_mm": 5.0}
    prediction = {name: {**off, **dict.fromkeys(WAYS, score)} for name in (*SOURCES, "all")}
    assert len(Compensation().chart({"prediction": prediction}).axes) == len(WAYS)


def test_no_robots_are_refused() -> None:
    with pytest.raises(ValueError, match="--robots 0"):
        Compensation(robots=0).run()
