"""Maps and solvers in small, against closed-form inverse kinematics."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw

from learning.reach.map import MapPrediction
from pps_vision.experiments.reach import paper_figures
from pps_vision.experiments.reach.error_bound import ErrorBound
from pps_vision.experiments.reach.map_truth import MapTruth, scores
from pps_vision.experiments.reach.maps import Maps
from pps_vision.experiments.reach.measures import Measures
from pps_vision.experiments.reach.repeated_maps import RepeatedMaps
from pps_vision.experiments.reach.solvers import Solvers


def test_scores_of_a_known_map() -> None:
    """Four reachable of which one is missed, one unreachable of which none is; R is off by 0.1 where it is known."""
    yes = np.array([True, True, True, False, False])
    truth = np.array([True, True, True, True, False])
    degree = np.array([0.9, 0.8, 0.7, 0.4, 0.2])
    said = MapPrediction(yes, yes, yes.astype(float), degree + np.array([0.1, -0.1, 0.1, -0.1, np.nan]))
    found = scores(said, truth, degree)
    assert found == {"je": 20, "fn": 25, "fp": 0, "degree_rmse": pytest.approx(0.1)}


@pytest.mark.long
def test_ours_needs_fewer_labels_than_the_baselines() -> None:
    study = Maps(SEED, n_test=1500, labels=(1000,))
    numbers, _ = run_and_draw(study)
    (ours,) = numbers["ours"]
    assert ours["je"] < 2
    assert all(ours["je"] < 0.6 * rows[0]["je"] for rows in numbers["baselines"].values())
    assert ours["degree_rmse"] < 0.04
    strict = [row["fp"] for row in numbers["thresholds"]]
    assert strict == sorted(strict)
    (row,) = study.tables(numbers)[""].rows
    assert row[:2] == ["1000", f"{ours['je']:.2g}"]


def test_the_batched_solver_is_faster_and_no_worse() -> None:
    study = Solvers(SEED, n=600, n_single=12)
    numbers, _ = run_and_draw(study)
    rows = numbers["solvers"]
    assert all(row["wrong_percent"] <= 10 for row in rows.values())
    batched = rows["batched, 2 starts"]
    assert batched["missed"] <= 3
    assert batched["optimality_lost"] < 0.02
    assert batched["ms"] < rows["SciPy, 1 start"]["ms"]
    assert [row[0] for row in study.tables(numbers)[""].rows] == list(rows)


@pytest.mark.long
def test_measures_are_learned_to_a_fraction_of_their_spread() -> None:
    study = Measures(SEED, n=1, n_labels=400, n_test=200, measures=("isotropy",))
    numbers, _ = run_and_draw(study)
    assert set(numbers["measures"]) == {"palm, isotropy", "left_forearm:27, joint-limits"}
    for row in numbers["measures"].values():
        assert row["je"][0] < 4
        assert row["rmse"][0] < 0.6 * row["spread"][0]


def test_more_single_problems_than_problems_is_an_error() -> None:
    with pytest.raises(ValueError, match="n_single 3 of n 2"):
        Solvers(n=2, n_single=3).run()


@pytest.mark.long
def test_stated_bounds_of_a_few_maps_hold() -> None:
    numbers, charts = run_and_draw(ErrorBound(SEED, n=1, requested=(0.05,), n_labels=300, n_test=1000))
    assert len(numbers["maps"]) == 2
    assert all(one["measured"] <= one["stated"] < 0.2 for one in numbers["maps"])
    assert set(charts) == {""}


def test_maps_of_each_arm_and_of_both_are_learned_with_every_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("N_YAWS", "N_VERGENCES"):
        monkeypatch.setattr(paper_figures, name, 8)
    study = RepeatedMaps(SEED, n=1, n_labels=300, n_test=400, lattice=0.15)
    numbers, charts = run_and_draw(study)
    left, right, of_both = numbers["maps"]
    assert [one["arm"] for one in (left, right, of_both)] == ["left", "right", "both"]
    assert all(one["je"] < 6 and one["degree_rmse"] < 0.08 for one in numbers["maps"])
    assert 0 < of_both["reachable"] < min(left["reachable"], right["reachable"])
    assert [row[:2] for row in study.tables(numbers)[""].rows] == [["left", "1"], ["right", "1"], ["both", "1"]]
    assert [len(figure.axes) for figure in charts.values()] == [5]


def truth(reachable: list[bool], optimality: list[float], error_m: list[float]) -> MapTruth:
    gaze = np.arange(12.0).reshape(4, 3)
    return MapTruth(gaze, np.array(reachable), np.array(optimality), np.array(error_m), gaze, np.array(reachable))


def test_both_hands_reach_as_the_worse_of_them_does() -> None:
    """Both; one; neither; one, the other's distance unknown."""
    nan = np.nan
    left = truth([True, True, False, True], [0.6, 0.5, nan, 0.4], [nan, nan, 0.2, nan])
    right = truth([True, False, False, False], [0.3, nan, nan, nan], [nan, 0.1, 0.5, nan])
    found = left.both(right)
    np.testing.assert_array_equal(found.reachable, [True, False, False, False])
    np.testing.assert_array_equal(found.box_reachable, found.reachable)
    np.testing.assert_array_equal(found.optimality, [0.3, nan, nan, nan])
    np.testing.assert_array_equal(found.error_m, [nan, 0.1, 0.5, nan])
    with pytest.raises(ValueError, match="different gaze postures"):
        left.both(replace(right, gaze_rad=right.gaze_rad + 1))
