"""Where the map breaks, in small: no fault teaches, the worst ones show, and what is past them is honest."""

from dataclasses import replace

import numpy as np
import pytest

from learning.reach.babbling import Babbled
from pps_vision.experiments.reach import map_failures
from pps_vision.experiments.reach.map_failures import CASES, WAYS, MapFailures, _World


@pytest.fixture(scope="module")
def world() -> _World:
    small = _World.of(3, 200, 500)
    few = Babbled(small.babbled.arm_rad[:600], small.babbled.gaze_rad[:600], 0)
    return replace(small, babbled=few, params=replace(small.params, lattice=0.12, n_babble=5000))


def test_ours_bears_what_the_papers_does_not(world: _World) -> None:
    """200 solutions each; a quarter of the samples of something else."""
    ours, as_j = (world.judge(way, "something else fixated", 25)["je"] for way in WAYS)
    assert ours < 5
    assert ours < 0.5 * as_j


@pytest.mark.parametrize(("fault", "severity"), [("elbow's encoder stuck", 100), ("fewer samples", 12)])
def test_past_the_break_it_stays_a_number_or_says_why(world: _World, fault: str, severity: float) -> None:
    for way in WAYS:
        judged = world.judge(way, fault, severity)
        assert np.isfinite([judged[name] for name in ("je", "fn", "fp", "unknown")]).all()
        assert judged["nothing_learned"] is not None or judged["unknown"] < 100


def test_it_is_measured_drawn_and_judged_by_its_criterion(monkeypatch: pytest.MonkeyPatch, world: _World) -> None:
    monkeypatch.setattr(map_failures, "CASES", {"labels flipped": ("share (%)", (0, 40))})
    monkeypatch.setattr(_World, "of", lambda *_: world)
    experiment = MapFailures(5, n_seeds=1, n_labels=200, n_test=500)
    numbers = experiment.run()
    ours = numbers["cases"]["labels flipped"]["ways"]["ours"]
    assert ours["je"][1]["mean"] > ours["je"][0]["mean"]
    assert ours["breaks_at"] in (0, 40)
    assert all(row["least"] == row["mean"] == row["most"] for row in ours["fn"])
    assert len(experiment.chart(numbers).axes) == 2


def test_the_mildest_of_each_fault_is_none() -> None:
    assert all(severities[0] in (0, 1500, 1000) for _, severities in CASES.values())


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="--n-labels 7"):
        MapFailures(n_labels=7).run()
