"""The demo of encounters: what its report shows, and (in make test-all) the report itself."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pps_vision.app.demo_encounters import Met, chosen, demo_encounters


def met(title: str, gap_m: float) -> Met:
    logs = [SimpleNamespace(surface_gap_m=np.array([[g, 1.0]]), was_touched=g <= 0.02) for g in (0.0, gap_m)]
    return Met(title, tuple(logs), Path("none"))  # type: ignore[arg-type]


def test_the_best_the_median_and_every_touched_one_are_shown_once() -> None:
    some = [met("a", 0.05), met("b", 0.01), met("c", 0.12), met("d", 0.015), met("e", 0.07)]
    assert [(what, one.title) for what, one in chosen(some)] == [
        ("Best", "c"),
        ("Median", "a"),
        ("Touched", "b"),
        ("Touched", "d"),
    ]
    assert [what for what, _ in chosen(some[:1])] == ["Only one"]
    assert some[0].left_m == pytest.approx(0.03)


@pytest.mark.skipif("PPS_VISION_ALL" not in os.environ, reason="renders for 15 s; in make test-all")
def test_a_report_of_one_encounter(tmp_path: Path) -> None:
    demo_encounters(tmp_path / "out", 1, 2.0, 7, share=0.1)
    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text())["encounters"]
    assert not row["touched"]
    text = (tmp_path / "out" / "report.html").read_text()
    assert text.count("<video") == 1
    assert row["encounter"] in text
