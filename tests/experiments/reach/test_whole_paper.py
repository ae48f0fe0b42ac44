"""The whole paper in small: every stage runs on what the one before it learned, and the figures show it."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_study import run_and_draw

from pps_vision.experiments.reach import paper_figures, whole_paper
from pps_vision.experiments.reach.whole_paper import WholePaper


@pytest.mark.long
def test_maps_from_babbling_alone_know_the_true_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("N_YAWS", "N_VERGENCES", "N_SIDE"):
        monkeypatch.setattr(paper_figures, name, 10)
    monkeypatch.setattr(whole_paper, "_PARAMS", replace(whole_paper._PARAMS, lattice=0.12, n_babble=5000))
    monkeypatch.setattr(whole_paper, "_N_TEST", 100)
    study = WholePaper(3, n=2, repetitions=20, n_tried=1500, labels=400, labels_of_j=400, n_test=400)
    numbers, figures = run_and_draw(study)
    ours, of_j = numbers["maps"].values()
    assert numbers["forward_model_deg"] < 1e-3
    assert ours["true"]["je"] < 4
    assert ours["true"]["je"] < of_j["true"]["je"]
    assert abs(ours["true"]["je"] - ours["learned"]["je"]) < 0.6
    value, low, high = numbers["estimated"]["ours"]["true"]["je"]
    assert low < value < high  # two repeats differ
    assert value == ours["true"]["je"]
    assert [len(figure.axes) for figure in figures.values()] == [5, 7, 7]
    for (name, at), (middle, low, high) in zip(numbers["extremes"].items(), numbers["repeated_extremes"], strict=True):
        assert low < middle < high, name
        assert 0.5 * low < at["vergence_deg"] < 2 * high, name
    drawn = numbers["space"]["training data"]
    assert len(drawn["gaze_deg"]) == len(drawn["reachable"]) <= 400
    np.testing.assert_array_equal(np.array(drawn["degree"]) > 50, np.array(drawn["reachable"], dtype=bool))  # percent


def test_simulator_coordinates_are_those_of_the_public_code() -> None:
    """J's box in the root frame, as the maps are judged in it."""
    corners = paper_figures.to_root(np.array([[-0.10, 0.75, 0.20], [0.10, 0.95, 0.35]]))
    np.testing.assert_allclose(corners, [[-0.226, 0.10, 0.1524], [-0.376, -0.10, 0.3524]])
    np.testing.assert_allclose(paper_figures.to_simulator(corners), [[-0.10, 0.75, 0.20], [0.10, 0.95, 0.35]])
