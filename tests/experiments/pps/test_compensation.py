"""An arm that knows nothing is touched, one that expects everything gets away; errors are told apart by case."""

import numpy as np
import pytest
from data import SEED

from learning.memory import MemoryParams, PPSMemory
from pps_vision.experiments.pps import compensation
from pps_vision.experiments.pps.compensation import CASES, WAYS, Compensation
from pps_vision.experiments.pps.errors import SOURCES, Belief, ErrorSources, only
from pps_vision.experiments.pps.flight import Fleeing, Flight
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
    perfect, erring = ("taught without", "tested without"), ("taught with", "tested with")
    found = {case: compensation._of(case, perfect, erring) for case in CASES}  # type: ignore[arg-type]
    assert found == {
        "no errors": perfect,
        "before learning": ("taught without", "tested with"),
        "after learning": erring,
    }


def test_flights_are_counted_and_drawn() -> None:
    counted = compensation._avoidance([Flight(True, np.nan), Flight(False, 1.0), Flight(False, 0.5)])
    assert counted == {"approaches": 3, "touched": 1, "never_moved": 1, "moved_before_s": 0.5}
    score = {case: {"auroc": 0.9, "brier": 0.1} for case in CASES}
    prediction = {name: {"error_mm": 10.0, **dict.fromkeys(WAYS, score)} for name in (*SOURCES, "all")}
    assert Compensation().chart({"prediction": prediction, "avoidance": dict.fromkeys(CASES, counted)}).axes


def test_no_robots_are_refused() -> None:
    with pytest.raises(ValueError, match="--robots 0"):
        Compensation(robots=0).run()
