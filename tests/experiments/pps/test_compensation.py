"""An arm that knows nothing is touched, one that expects everything gets away; errors are told apart by case."""

import numpy as np
import pytest
from data import SEED
from pps_vision.experiments.pps.flight import Fleeing

from learning.pps.memory import MemoryParams, PPSMemory
from pps_vision.experiments.pps import compensation
from pps_vision.experiments.pps.compensation import WAYS, Compensation
from pps_vision.experiments.pps.errors import SOURCES, Belief, ErrorSources, only
from pps_vision.experiments.pps.lives import CASES
from pps_vision.robot.skin import icub_skin

SKIN = icub_skin()


def sure(expecting: bool) -> PPSMemory:
    counts = np.zeros((len(SKIN.taxel_ids), 8, 4, 2), np.int64)
    counts[..., 0 if expecting else 1] = 5
    return PPSMemory(SKIN.taxel_ids, SKIN.part_index, counts, MemoryParams())


@pytest.mark.parametrize(("sources", "expecting"), [(only(), True), (ErrorSources(), True), (only(), False)])
def test_who_expects_a_touch_flees_it(sources: ErrorSources, expecting: bool) -> None:
    rng = np.random.default_rng(SEED)
    fleeing = Fleeing(Belief.draw(sources, SKIN, rng), SKIN, sure(expecting))
    motion = fleeing.approach("left_forearm:15", 0.035, 0.1, rng)
    flight = fleeing.meet(motion, 0.035, rng)
    assert flight.touched is not expecting
    assert np.isnan(flight.moved_before_s) is not expecting


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
