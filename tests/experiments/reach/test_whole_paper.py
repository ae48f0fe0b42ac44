"""The whole paper in small: every stage runs on what the one before it learned, and the figures show it."""

from functools import partial

import numpy as np
import pytest

from learning.reach.training import MapParams
from pps_vision.experiments.reach import paper_figures, whole_paper
from pps_vision.experiments.reach.paper_figures import _lines, _numbers
from pps_vision.experiments.reach.whole_paper import WholePaper


def test_from_babbling_to_maps_that_know_the_true_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_YAWS", "_VERGENCES", "_SIDE"):
        monkeypatch.setattr(paper_figures, name, 10)
    monkeypatch.setattr(whole_paper, "MapParams", partial(MapParams, lattice=0.12, n_babble=5000))
    monkeypatch.setattr(whole_paper, "_N_TRIED", 1500)
    monkeypatch.setattr(whole_paper, "_N_TEST", 100)
    paper = WholePaper(seed=3, labels=(400,), labels_as_j=400, n_test=400)
    numbers = paper.run()
    ours, as_j = numbers["maps"].values()
    assert numbers["forward_model_deg"] < 1e-3
    assert ours["true"]["je"] < 4
    assert ours["true"]["je"] < as_j["true"]["je"]
    assert abs(ours["true"]["je"] - ours["learned"]["je"]) < 0.6
    assert all(0 < s < numbers["goal_s"] for s in numbers["from_babbling_to_the_map_s"].values())
    figures = paper.chart(numbers)
    assert [len(figure.axes) for figure in figures.values()] == [7, 7]


def test_a_grid_is_written_and_read_back() -> None:
    degree = np.array([[0.25, np.nan, 1.0], [0.0, 0.51, 0.07]])
    np.testing.assert_allclose(_numbers(_lines(degree.ravel(), 3)), degree)


def test_too_few_labels_are_named() -> None:
    with pytest.raises(ValueError, match=r"labels \(50,\)"):
        WholePaper(labels=(50,)).run()
