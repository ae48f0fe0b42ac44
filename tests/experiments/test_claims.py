"""The README's table says what the result files say."""

import json
import re
from pathlib import Path

import pytest

from pps_vision.experiments.claims import CLAIMS, Claims
from pps_vision.experiments.study import catalogue

RESULTS = Path(__file__).parents[2] / "docs" / "results"
MEASURED = [claim for claim in CLAIMS if (RESULTS / f"{claim.study}.json").exists()]
RUN = {"machine": {"commit": "abc1234", "processor": "a processor, 2 cores"}, "parameters": {"seed": 7}}
RUN |= {"processor_min": 2.5}


def test_every_claim_is_measured_by_a_study() -> None:
    assert {claim.study for claim in CLAIMS} <= set(catalogue())


def test_a_claim_is_read_from_its_study_and_absent_ones_are_left_out(tmp_path: Path) -> None:
    counts = {"avoidance on": 1, "avoidance off": 19, "receding": 0, "static": 2, "own arm": 3}
    numbers = {case: {"touched": count, "commanded": count} for case, count in counts.items()}
    (tmp_path / "loop.json").write_text(json.dumps({**RUN, "n": 20, **numbers}))
    study = Claims(tmp_path)
    numbers = study.run()
    (row,), (run,) = numbers["claims"], numbers["studies"]
    assert row["measured"] == "**1** / **19** of 20; 0, **2**, **3** of 20", "what misses the goal is bold"
    assert (run["commit"], run["seed"], run["n"], run["study"]) == ("abc1234", 7, 20, "loop")
    tables = study.tables(numbers)
    assert tables[""].rows[0][2] == row["measured"]
    lasts = [list(line)[-1] for line in tables["studies"].rows]
    assert lasts == ["2.5", "2", "≥ 1"]  # of the study, of all, and of two cores
    long = study.tables({**numbers, "studies": [{**run, "processor_min": 400}]})["studies"].rows
    assert long[-1][-1] == "**≥ 200**", "more than three hours"


def test_the_pages_named_for_the_studies_show_them() -> None:
    docs = RESULTS.parent
    rows = [line for line in (docs / "measured.md").read_text().splitlines() if line.startswith("| [")]
    named = set()
    for row in rows:
        pages = "".join((docs / page).read_text() for page in re.findall(r"\((\w+\.md)\)", row))
        studies = re.findall(r"`(\w+?_?)…?`", row)
        assert all(study in pages for study in studies), row
        named |= set(studies)
    groups = tuple(study for study in named if study.endswith("_"))
    assert set(catalogue()) - {"claims"} == {one for one in catalogue() if one in named or one.startswith(groups)}


@pytest.mark.parametrize("claim", MEASURED, ids=lambda claim: claim.study)
def test_what_the_documents_claim_follows_from_the_results(claim) -> None:
    claims = json.loads((RESULTS / "claims.json").read_text())["claims"]
    (published,) = (one["measured"] for one in claims if one["study"] == claim.study)
    assert claim.measured(json.loads((RESULTS / f"{claim.study}.json").read_text())) == published


def test_what_a_short_run_could_not_measure_is_not_a_number(tmp_path: Path) -> None:
    lost = {"mean_recording_mm": [None] * 3, "worst_recording_mm": [None] * 3, "near_percent": [0.0, 0.0, 0.0]}
    found = {"mean_recording_mm": [0.4, 0.3, 0.5], "worst_recording_mm": [2, 1, 3], "near_percent": [100, 99, 100]}
    cells = {"rendered, ball": {"tracker": lost}, "rendered, marker": {"tracker": found}}
    (tmp_path / "tracking.json").write_text(json.dumps({**RUN, "cells": cells}))
    (row,) = Claims(tmp_path).run()["claims"]
    assert row["measured"] == "nan / 0.40 mm, worst recording nan / 2.00 mm; tracked **0** / 100 % of the time"


def test_every_study_has_a_row_and_a_test_in_the_protocol() -> None:
    """`claims` reads the others' results."""
    claims, tests = (RESULTS.parent / "protocol.md").read_text().split("## Tests and intervals")
    studies = set(catalogue()) - {"claims"}
    rows = [line.split("|") for line in claims.splitlines() if line.startswith("|")][2:]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row[4])} == studies
    assert all(cell.strip() for row in rows for cell in row[1:6])
    named = [
        name
        for line in tests.splitlines()
        for name in re.findall(r"`(\w+)`", line.rpartition("|")[0].rpartition("|")[2])
    ]
    assert sorted(named) == sorted(studies)
