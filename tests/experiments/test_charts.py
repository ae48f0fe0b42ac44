"""The five charts draw what they are given, losses included."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from pps_vision.experiments.charts import (
    PAGE_IN,
    bars,
    calibration,
    curves,
    panels,
    pareto_front,
    severities,
    severity,
    speed_error,
    speed_errors,
)
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import read_numbers

KNOWN, DOCS = catalogue(), Path(__file__).parents[2] / "docs"
SLOW = "independent", "encounters_sessions"


@pytest.fixture
def axis():
    figure, (axis,) = panels(1)
    yield axis
    figure.draw_without_rendering()


def test_the_front_holds_what_no_other_beats() -> None:
    assert pareto_front([1, 2, 3, 4, 2], [5, 3, 4, np.nan, 9]) == [0, 1]
    assert pareto_front([1, 2, 3], [np.nan, 3, 3]) == [1], "no error is no point; the slower of equals is beaten"


def test_speed_error_marks_default_front_and_failures(axis) -> None:
    methods = {
        "fast": {"ms": [0.9, 1, 1.1], "error": [5, 4, 6]},
        "best": {"ms": [9, 10, 11], "error": [1, 0.5, 2]},
        "lost": {"ms": [1, 2, 3], "error": [None, None, None]},
    }
    speed_error(axis, methods, "error", baselines={"fast"}, default="best")
    front = next(line for line in axis.lines if line.get_linestyle() == ":")
    np.testing.assert_allclose(front.get_xydata(), [[1, 5], [10, 1]])
    rings = [line for line in axis.lines if line.get_markersize() == 12]
    np.testing.assert_allclose(rings[0].get_xydata(), [[10, 1]])
    assert {text.get_text() for text in axis.texts} == {"fast", "best", "lost (fails)"}
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "linear")
    points = {tuple(line.get_xydata()[0]): line for line in axis.lines if line.get_markersize() == 5}
    assert points[1, 5].get_color() != points[10, 1].get_color() == points[2, 5 * 1.15].get_color()
    assert points[2, 5 * 1.15].get_marker() == "x", "above all others"
    drawn = [(list(line.get_xdata()), list(line.get_ydata())) for line in axis.lines]
    for quartiles_and_interval in (([0.9, 1.1], [5, 5]), ([1, 1], [4, 6]), ([9, 11], [1, 1]), ([10, 10], [0.5, 2])):
        assert quartiles_and_interval in drawn
    assert ([1, 3], [5 * 1.15] * 2) in drawn
    assert axis.get_ylim() == pytest.approx((0, 1.1 * 6)), "from 0 to beyond the highest interval"
    named = {line.get_label(): line.get_color() for line in axis.lines if line.get_label()[0] != "_"}
    assert set(named) == {"ours", "baseline", "default"}
    assert named["ours"] == points[10, 1].get_color()
    assert named["baseline"] == points[1, 5].get_color()


def test_names_of_near_points_neither_meet_nor_leave_the_axes() -> None:
    """Three points a hair apart, one at each edge; as they are drawn. No name lies on the front's line."""
    figure, (axis,) = panels(1)
    at = {"first of three": (1.0, 5), "second of three": (1.01, 5), "third of three": (1.02, 5)}
    at |= {"at the right edge": (90, 3), "below": (10, 0), "above": (8, 9)}
    speed_error(axis, {name: {"ms": ms, "error": error} for name, (ms, error) in at.items()}, "error")
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in axis.texts]  # without the line to the point
    inside = axis.get_window_extent().padded(3)
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
        assert inside.x0 <= box.x0 < box.x1 <= inside.x1
        assert inside.y0 <= box.y0 < box.y1 <= inside.y1
    front = axis.transData.transform(next(line for line in axis.lines if line.get_linestyle() == ":").get_xydata())
    between = np.linspace(front[:-1], front[1:], 50).reshape(-1, 2)
    assert not any(box.padded(-1).contains(*point) for box in boxes for point in between)


@pytest.mark.parametrize(("least", "scale"), [(1, "log"), (1.1, "linear"), (0.0, "linear")])
def test_errors_that_span_decades_are_drawn_on_a_logarithmic_axis(axis, least: float, scale: str) -> None:
    speed_error(axis, {"a": {"ms": 1, "error": least}, "b": {"ms": 2, "error": 31}}, "error")
    assert axis.get_yscale() == scale


def test_speed_errors_have_a_panel_for_each_scenario_two_side_by_side() -> None:
    cells = {s: {"ours": {"ms": k, "mm": 10 * k}} for k, s in enumerate("abc", 1)}
    figure = speed_errors(cells, "mm", "error (mm)", default="ours")
    shown = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_title() for axis in shown] == ["a", "b", "c"]
    assert [axis.get_ylabel() for axis in shown] == ["error (mm)", "", "error (mm)"]
    assert [axis.lines[3].get_xydata()[0].tolist() for axis in shown] == [[k, 10 * k] for k in range(1, 4)]
    assert shown[2].get_subplotspec().rowspan.start == 1
    assert figure.get_figwidth() == PAGE_IN


def test_severity_marks_the_break(axis) -> None:
    cell = {"error": [[1, 1, 1], [2, 1, 3], [None, None, None]], "breaks_at": 20}
    severity(axis, {"axis": "noise", "severities": [0, 10, 20], "methods": {"ours": cell}}, "error", "error (mm)", 3)
    cross = next(line for line in axis.lines if line.get_marker() == "x")
    assert cross.get_xdata()[0] == 2
    assert any(list(line.get_ydata()) == [3, 3] for line in axis.lines), "the bound"
    assert [tick.get_text() for tick in axis.get_xticklabels()] == ["0", "10", "20"]


def test_severities_have_a_panel_for_each_disturbance() -> None:
    cell = {"error": [[1, 1, 1], [2, 1, 3]], "breaks_at": None}
    study = {"axis": "noise", "severities": [0, 10], "methods": {"ours": cell, "theirs": cell}}
    figure = severities({"first": study, "second": study}, "error", "error (mm)", 3, columns=1)
    assert [axis.get_title() for axis in figure.axes] == ["first", "second"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["ours", "theirs"]


def test_calibration_curves_and_bars_draw_values_with_intervals(axis) -> None:
    calibration(axis, [68, 95], {"position": [[70, 60, 85], [93, 90, 96]], "velocity": [60, 90]}, "found (%)")
    np.testing.assert_array_equal(axis.lines[0].get_xydata(), [[0, 0], [100, 100]])
    ranges = [c.lines[2][0].get_segments() for c in axis.containers]
    np.testing.assert_allclose(ranges[0][0], [[67.7, 60], [67.7, 85]])
    np.testing.assert_allclose(ranges[1][0], [[68.3, 60], [68.3, 60]], err_msg="a number has no interval")
    curves(axis, [1, 2], {"ours": [[1, 0, 2], 3]}, "n", "error")
    np.testing.assert_allclose(axis.lines[-1].get_xydata(), [[1, 1], [2, 3]])
    bars(axis, ["a", "b"], {"one": [1, None], "two": [[2, 1, 3], 4]}, "error")
    shown = [bar for bar in axis.patches if np.isfinite(bar.get_height())]
    assert [bar.get_height() for bar in shown] == [1, 2, 4]
    assert [bar.get_x() + bar.get_width() / 2 for bar in shown] == pytest.approx([-0.2, 0.2, 1.2])


@pytest.mark.parametrize("study", [pytest.param(s, marks=[pytest.mark.long] * (s in SLOW)) for s in KNOWN])
def test_the_documents_charts_follow_from_the_results(study: str) -> None:
    """Every figure of a study in the documents is drawn from its numbers."""
    drawn = KNOWN[study]().chart(read_numbers(DOCS / "results" / f"{study}.json"))
    charts = {"": drawn} if isinstance(drawn, Figure) else drawn
    files = {f"{study}_{part}.png" if part else f"{study}.png" for part in charts}
    others = tuple(name for name in KNOWN if name.startswith(f"{study}_"))
    published = {file.name for file in (DOCS / "figures").glob(f"{study}*.png") if not file.name.startswith(others)}
    assert published <= files
    for figure in charts.values():
        assert any(axis.lines or axis.collections or axis.patches or axis.images for axis in figure.axes)
