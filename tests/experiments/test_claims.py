"""The claims of README.md follow from the results."""

import json
from pathlib import Path

from pps_vision.experiments.claims import CLAIMS, claims_table
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import filled, markdown

ROOT = Path(__file__).parents[2]


def test_the_readme_claims_what_the_results_say() -> None:
    table = claims_table(ROOT / "docs" / "results")
    text = (ROOT / "README.md").read_text()
    assert filled(text, {"claims": markdown(table)}, ROOT / "README.md") == text
    assert len(table.rows) == len(CLAIMS)
    assert {claim.study for claim in CLAIMS} <= set(catalogue())


def test_a_missed_goal_is_bold_and_a_claim_without_a_result_has_no_row(tmp_path: Path) -> None:
    counts = {"avoidance on": 1, "avoidance off": 19, "receding": 0, "static": 2, "own arm": 3}
    numbers = {case: {"touched": count, "commanded": count} for case, count in counts.items()}
    (tmp_path / "loop.json").write_text(json.dumps({"n": 20, **numbers}))
    (row,) = claims_table(tmp_path).rows
    assert row[2] == "**1** / **19** of 20; 0, **2**, **3** of 20"
