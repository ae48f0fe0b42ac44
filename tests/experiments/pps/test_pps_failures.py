"""Where the learned map breaks: nothing wrong, it predicts; everything wrong, it is no better than chance."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.pps import failures
from pps_vision.experiments.pps.failures import CASES, METHODS, Case, PpsFailures, World, first, measured


def scores(world, k=0):
    return dict(zip(METHODS, measured(world, np.random.default_rng([SEED, k])), strict=True))


def test_undisturbed_the_map_foretells_and_beats_both_peers():
    found = scores(World())
    print(found)
    ours, distance, rate = (found[name] for name in ("ours (8×4)", "distance only", "base rate"))
    assert ours[0] > 0.87
    assert ours[0] > distance[0] > rate[0]
    assert ours[1] < min(distance[1], rate[1])


@pytest.mark.parametrize("name", CASES)
def test_the_worst_severity_costs(name):
    case = CASES[name]
    mild, hopeless = (
        scores(case.world(severity))["ours (8×4)"] for severity in (case.severities[0], case.severities[-1])
    )
    assert hopeless[0] < mild[0] - 0.05
    assert hopeless[1] > mild[1]


def test_noise_no_map_can_bear_leaves_chance():
    area, _ = scores(CASES["track noise"].world(300))["ours (8×4)"]
    assert 0.4 < area < 0.65


def test_the_chart_is_drawn_from_the_numbers(monkeypatch):
    monkeypatch.setattr(failures, "CASES", {"too few trials": Case("trials", (20, 2), lambda v: World(trials=int(v)))})
    experiment = PpsFailures(SEED, repeats=1)
    numbers = experiment.run()
    assert set(numbers["cases"]["too few trials"]["methods"]) == set(METHODS)
    assert len(experiment.chart(numbers).axes) == 2


def test_the_mildest_bad_severity_is_named():
    assert first((0, 1, 2), np.array([False, True, True])) == 1
    assert first((0, 1, 2), np.zeros(3, bool)) is None
