"""The demo of encounters: what its report shows, and (in make test-all) the report itself."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from episodes import episode_log

from pps_vision.app import demo_encounters as module
from pps_vision.app.demo import write_side_by_side
from pps_vision.app.demo_encounters import DemoEncounter, _page, chosen, demo_encounters
from pps_vision.app.encounters.encounter import HAZARDS
from pps_vision.app.report import page
from pps_vision.app.simulation import Episode, EpisodeLog
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


def test_every_encounter_is_met_without_and_with_avoidance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four of three conditions, each of its own seed; without avoidance all are touched, with it the last one."""
    met_with: list[tuple[object, ...]] = []

    @contextmanager
    def opened(scene: object, encounter: SimpleNamespace, noise: float, seed: int) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(encounter=encounter, noise=noise, seed=seed)

    def drawn_lots(scene: object, condition: str, number: int, seed: int) -> SimpleNamespace:
        of = {"condition": condition, "number": number, "side": "right" if number else "left", "part": "palm"}
        return SimpleNamespace(**of, stimulus="ball", speed_m_s=0.1, motion=None, seconds=2.0, seed=seed)

    def logged(world: SimpleNamespace, episode: Episode, steps: list[int], avoid: bool) -> EpisodeLog:
        assert (steps, episode.seconds, episode.title) == ([1, 2], 2.0, f"avoidance {'on' if avoid else 'off'}")
        one = world.encounter
        met_with.append((one.condition, one.number, world.noise, world.seed, one.seed, avoid))
        log, is_near = episode_log(False), not avoid or one.number == 1
        gaps = np.full_like(log.surface_gap_m, 0.01 if is_near else 0.06)
        return replace(log, surface_gap_m=gaps, touched=gaps <= TOUCH_RADIUS_M)

    def simulated(world: object, episode: Episode, step: str, avoid: bool) -> Iterator[int]:
        assert step == f"memory of {'right' if world.encounter.number else 'left'} 7 0.5"  # type: ignore[attr-defined]
        return iter((1, 2))

    replaced = {
        "EncounterScene": lambda: None,
        "learn": lambda scene, side, seed, share: SimpleNamespace(of_both=f"memory of {side} {seed} {share}"),
        "draw": drawn_lots,
        "open_encounter": opened,
        "new_pipeline": lambda world, memory: SimpleNamespace(step=memory),
        "simulate": simulated,
        "drawn": lambda world, step, title: np.zeros((48, 64, 3), np.uint8),
        "log_of": logged,
    }
    for name, instead in replaced.items():
        monkeypatch.setattr(module, name, instead)
    monkeypatch.setattr(page, "image", lambda figure: "")
    demo_encounters(tmp_path / "out", 4, 2.0, 7, share=0.5)
    conditions = [*HAZARDS, HAZARDS[0]]
    assert met_with == [(conditions[k], k // 3, 2.0, 7 + k, 7, avoid) for k in range(4) for avoid in (False, True)]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["seed"], summary["noise_grey_levels"]) == (7, 2.0)
    rows = summary["encounters"]
    assert [row["touched"] for row in rows] == [False] * 3 + [True]
    assert [row["left_mm"] for row in rows] == pytest.approx([40.0] * 3 + [-10.0])
    assert rows[3]["encounter"] == f"{HAZARDS[0]} 1: ball, 10 cm/s, right palm"
    text = (tmp_path / "out" / "report.html").read_text()
    assert "4 encounters, 1 touched" in text
    assert text.count("<video") == 3
    printed = capsys.readouterr()
    assert printed.out == f"1 of 4 touched → {tmp_path / 'out' / 'report.html'}\n"
    assert printed.err.startswith("encounters: 0 of 4 after 00:00\n")
