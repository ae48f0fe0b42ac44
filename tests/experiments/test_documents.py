"""The documents follow from the results: claims, tables, charts and tuned parameters."""

import json
from pathlib import Path

import numpy as np
import pytest
from documents import ROOT
from matplotlib.figure import Figure

from pps_vision.errors import InputError
from pps_vision.experiments.bench import bench
from pps_vision.experiments.charts import pareto_front
from pps_vision.experiments.claims import CLAIMS, claims_table
from pps_vision.experiments.encounters.controllers import BASELINES, TUNED
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import Table, filled, markdown, names, read_numbers

KNOWN, DOCS = catalogue(), ROOT / "docs"
SLOW = "independent", "encounters_sessions"
PAGE = Path("page.md")
TEXT = "a\n<!-- table: one -->\nold | row\n<!-- end -->\nb\n<!-- table: two -->\nkept\n<!-- end -->\n"


def test_the_readme_claims_what_the_results_say():
    table = claims_table(DOCS / "results")
    text = (ROOT / "README.md").read_text()
    assert filled(text, {"claims": markdown(table)}, ROOT / "README.md") == text
    assert len(table.rows) == len(CLAIMS)
    assert {claim.study for claim in CLAIMS} <= set(KNOWN)


def test_a_missed_goal_is_bold_and_a_claim_without_a_result_has_no_row(tmp_path):
    counts = {"avoidance on": 1, "avoidance off": 19, "receding": 0, "static": 2, "own arm": 3}
    numbers = {case: {"touched": count, "commanded": count} for case, count in counts.items()}
    (tmp_path / "loop.json").write_text(json.dumps({"n": 20, **numbers}))
    (row,) = claims_table(tmp_path).rows
    assert row[2] == "**1** / **19** of 20; 0, **2**, **3** of 20"


def test_tracking_on_independent_scenes_alone_makes_no_claim(tmp_path):
    part = {"parameters": {"scenes": "independent"}, "cells": {"independent, ball": {}}}
    (tmp_path / "tracking.json").write_text(json.dumps({"accuracy": part, "consistency": part, "pipeline": part}))
    assert claims_table(tmp_path).rows == []


def test_only_what_stands_between_the_markers_changes():
    assert names(TEXT) == ["one", "two"]
    tables = {"one": markdown(Table(["what", "mm"], [["ball", "1"]]))}
    new = filled(TEXT, tables, PAGE)
    assert new == TEXT.replace("old | row\n", "| what | mm |\n| --- | ---: |\n| ball | 1 |\n")
    assert filled(new, tables, PAGE) == new


def test_a_marker_without_end_is_refused():
    with pytest.raises(InputError, match=r"page\.md.*without its end"):
        filled("<!-- table: one -->\n| what |\n", {"one": ""}, PAGE)


@pytest.mark.parametrize("study", KNOWN)
def test_the_documents_hold_the_tables_that_follow_from_the_results(study):
    """As `bench --redraw` fills them."""
    numbers = read_numbers(DOCS / "results" / f"{study}.json")
    tables = KNOWN[study]().tables(numbers)
    made = {f"{study}_{part}" if part else study: markdown(table) for part, table in tables.items()}
    for document in (*DOCS.glob("*.md"), DOCS.parent / "README.md"):
        text = document.read_text()
        assert filled(text, made, document) == text
        assert {name for name in names(text) if f"{name}_".startswith(f"{study}_")} <= set(made)


def test_the_front_holds_what_no_other_beats():
    assert pareto_front([1, 2, 3, 4, 2], [5, 3, 4, np.nan, 9]) == [0, 1]
    assert pareto_front([1, 2, 3], [np.nan, 3, 3]) == [1], "no error is no point; the slower of equals is beaten"


@pytest.mark.parametrize("study", [pytest.param(s, marks=[pytest.mark.long] * (s in SLOW)) for s in KNOWN])
def test_the_documents_charts_follow_from_the_results(study):
    """Every figure of a study in the documents is drawn from its numbers."""
    drawn = KNOWN[study]().chart(read_numbers(DOCS / "results" / f"{study}.json"))
    charts = {"": drawn} if isinstance(drawn, Figure) else drawn
    files = {f"{study}_{part}.png" if part else f"{study}.png" for part in charts}
    others = tuple(name for name in KNOWN if name.startswith(f"{study}_"))
    published = {file.name for file in (DOCS / "figures").glob(f"{study}*.png") if not file.name.startswith(others)}
    assert published <= files
    for figure in charts.values():
        assert any(axis.lines or axis.collections or axis.patches or axis.images for axis in figure.axes)


def test_tuned_parameters_are_those_of_the_tuning_study():
    tuned = read_numbers(DOCS / "results" / "encounters.json")["tuning"]["best"]
    best = {name: {k: v for k, v in of.items() if k != "score"} for name, of in tuned.items() if name in BASELINES}
    assert best == {name: TUNED[name] for name in BASELINES}
    for name, (_, _, ranges) in BASELINES.items():
        assert all(low <= TUNED[name][k] <= high for k, (low, high) in ranges.items())


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN)
def test_a_short_run_has_every_chart_and_table(name, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    bench([name], out=tmp_path, short=True)
    study = KNOWN[name]()
    numbers = read_numbers(tmp_path / "results" / f"{name}.json")
    tables = study.tables(numbers)
    published = study.tables(read_numbers(DOCS / "results" / f"{name}.json"))
    assert set(tables) == set(published)
    assert all(list(table.header) and len(table.rows) for table in tables.values())
    charts = study.chart(numbers)
    n_charts = 1 if isinstance(charts, Figure) else len(charts)
    assert len(list((tmp_path / "figures").glob("*.png"))) == n_charts
