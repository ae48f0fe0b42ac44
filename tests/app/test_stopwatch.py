"""Times of stages, from a clock that is known."""

import pytest

from pps_vision.app import stopwatch as module
from pps_vision.app.stopwatch import Stopwatch


def test_the_times_of_a_stage_are_its_quartiles_in_milliseconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of 1, 2, 3, 4 and 5 s, and a block of 8 s of four equal runs."""
    clock = iter((10.0, 11.0, 20.0, 22.0, 30.0, 33.0, 40.0, 44.0, 50.0, 55.0, 60.0, 68.0))
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(clock))
    stopwatch = Stopwatch()
    for _ in range(5):
        with stopwatch("look"):
            pass
    with stopwatch("act", 4):
        pass
    assert stopwatch.summary() == {
        "look": {"q25_ms": 2000.0, "median_ms": 3000.0, "q75_ms": 4000.0, "runs": 5},
        "act": {"q25_ms": 2000.0, "median_ms": 2000.0, "q75_ms": 2000.0, "runs": 4},
    }


def test_a_stage_that_fails_is_timed_too() -> None:
    stopwatch = Stopwatch()
    with pytest.raises(ZeroDivisionError), stopwatch("look"):
        _ = 1 / 0
    assert stopwatch.summary()["look"]["runs"] == 1
