"""The demo of encounters: what its report shows, and (in make test-all) the report itself."""

import json
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest

from pps_vision.app.demo import write_side_by_side
from pps_vision.app.demo_encounters import DemoEncounter, chosen, demo_encounters


def met(title: str, gap_m: float) -> DemoEncounter:
    logs = [SimpleNamespace(surface_gap_m=np.array([[g, 1.0]]), was_touched=g <= 0.02) for g in (0.0, gap_m)]
    return DemoEncounter(title, tuple(logs), Path("none"))  # type: ignore[arg-type]


def test_the_best_the_median_and_every_touched_one_are_shown_once() -> None:
    some = [met("a", 0.05), met("b", 0.01), met("c", 0.12), met("d", 0.015), met("e", 0.07)]
    assert [(label, encounter.title) for label, encounter in chosen(some)] == [
        ("Best", "c"),
        ("Median", "a"),
        ("Touched", "b"),
        ("Touched", "d"),
    ]
    assert [label for label, _ in chosen(some[:1])] == ["Only one"]
    assert some[0].left_m == pytest.approx(0.03)


@pytest.mark.long
def test_a_report_of_one_encounter(tmp_path: Path) -> None:
    demo_encounters(tmp_path / "out", 1, 2.0, 7, share=0.1)
    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text())["encounters"]
    assert not row["touched"]
    text = (tmp_path / "out" / "report.html").read_text()
    assert text.count("<video") == 1
    assert row["encounter"] in text


def test_both_runs_are_filmed_side_by_side(tmp_path: Path) -> None:
    left, right = ([np.full((48, 64, 3), level + 20 * k, np.uint8) for k in range(3)] for level in (40, 140))
    write_side_by_side(tmp_path / "a.mp4", (left, right), (left[:1], right[:2]))
    with av.open(str(tmp_path / "a.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in film.decode(video=0)]
    assert [frame.shape for frame in frames] == [(48, 128, 3)] * 5
    for frame, (k, j) in zip(frames, ((0, 0), (1, 1), (2, 2), (0, 0), (0, 1)), strict=True):  # the shorter one waits
        assert frame[:, 8:56].mean() == pytest.approx(40 + 20 * k, abs=5)
        assert frame[:, 72:120].mean() == pytest.approx(140 + 20 * j, abs=5)
