"""The demo of encounters: what its report shows, and (in make test-all) the report itself."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from episodes import episode_log

from pps_vision.app.demo import write_side_by_side
from pps_vision.app.demo_encounters import DemoEncounter, _page, chosen, demo_encounters
from pps_vision.app.report import page
from pps_vision.robot.skin import TOUCH_RADIUS_M


def met(title: str, gap_m: float) -> DemoEncounter:
    logs = [SimpleNamespace(surface_gap_m=np.array([[g, 1.0]]), was_touched=g <= 0.02) for g in (0.0, gap_m)]
    return DemoEncounter(title, tuple(logs), Path("none"))  # type: ignore[arg-type]


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


def test_the_report_lists_all_encounters_and_shows_the_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "image", lambda figure: "")
    log, some = episode_log(False), []
    for k, gap_m in enumerate((0.015, 0.05, 0.12)):
        black = [np.zeros((48, 64, 3), np.uint8)] * 2
        write_side_by_side(tmp_path / f"{k}.mp4", (black, black))
        gaps = np.full_like(log.surface_gap_m, gap_m)
        on = replace(log, surface_gap_m=gaps, touched=gaps <= TOUCH_RADIUS_M)
        some.append(DemoEncounter(f"encounter {k}", (log, on), tmp_path / f"{k}.mp4"))
    text = _page(some, 2.0, 7)
    assert "3 encounters, 1 touched" in text
    assert text.count("<video") == 3  # best, median, touched
    for row in ("<td>encounter 0</td><td>touched</td><td>-5</td>", "<td>encounter 1</td><td></td><td>30</td>"):
        assert row in text
    assert "<td>encounter 2</td><td></td><td>100</td>" in text
    assert text.index("Best: encounter 2") < text.index("Median: encounter 1") < text.index("Touched: encounter 0")
    assert "σ = 2/255, seed 7" in text
