"""Processor times of calls."""

import pytest

from pps_vision.experiments.timing import timed, timed_runs, timed_steps


def test_every_step_is_timed_in_turn() -> None:
    seen: list[int] = []
    found, ms = timed_steps(lambda k: seen.append(k) or sum(range(200_000 * k)), (1, 3))
    assert seen == [1, 3]
    assert found == [sum(range(200_000)), sum(range(600_000))]
    assert ms[1] / ms[0] == pytest.approx(3, rel=0.5)
    assert 0.5 < ms[0] < 100


def test_the_run_that_fills_caches_does_not_count() -> None:
    sizes = iter((3_000_000, 30_000, 30_000, 30_000))
    ms = timed_runs(lambda: sum(range(next(sizes))), 3)
    assert (len(ms), next(sizes, None)) == (3, None)
    assert max(ms) < 0.5 * timed(lambda: sum(range(3_000_000)))[1]
