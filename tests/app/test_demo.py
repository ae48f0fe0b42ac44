"""The demo's numbers, from a made-up log, and its whole run with training and episodes cut short."""

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pytest
from episodes import STAMPS, T, episode_log

from learning.pps.memory import PPSMemory, load_memory
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice
from learning.reach.map import ReachableMap
from pps_vision.app import demo as module
from pps_vision.app.demo import THRESHOLD, _cell, _numbers, demo
from pps_vision.app.simulation import World
from pps_vision.types import Reachability, ReachStatus, Status


def test_an_episodes_row_says_what_happened() -> None:
    log = episode_log(True)
    activations, commanded = np.full((T, 2), 0.5 * THRESHOLD), np.zeros(T, bool)
    activations[3:, 1], commanded[5] = 1.5 * THRESHOLD, True
    track = log.track_m.copy()
    track[:2] = np.nan
    status = (Status.SEARCHING,) * 2 + (Status.TRACKING,) * (T - 2)
    log = replace(log, activations=activations, track_m=track, status=status, arm_commanded=commanded)
    found = _numbers(log)
    assert found["touched"] is True
    assert found["arm_moved"] is True
    assert found["smallest_gap_mm"] == pytest.approx(1000 * log.surface_gap_m.min())
    assert found["highest_activation"] == pytest.approx(1.5 * THRESHOLD)
    assert found["predicted_after_s"] == pytest.approx(0.3)
    assert found["tracked_share"] == pytest.approx(9 / 11)
    assert found["track_rms_mm"] == pytest.approx(5.0)  # 3 and 4 mm off along two axes
    assert found["reachable_share"] == pytest.approx(4 / 9)  # of nine frames in which it is tracked
    assert found["degree_of_reach"] == pytest.approx(np.mean(np.arange(2, 11) / 10))


def test_what_is_not_known_has_no_number() -> None:
    log = episode_log(False)
    log = replace(log, activations=0 * log.activations, track_m=np.full((T, 3), np.nan), touched=log.touched & False)
    found = _numbers(log)
    none = ("predicted_after_s", "track_rms_mm", "reachable_share", "degree_of_reach")
    assert [key for key, value in found.items() if value is None] == list(none)
    assert found["touched"] is False
    assert found["arm_moved"] is False
    unfixated = tuple(Reachability.without_answer(t, ReachStatus.NOT_FIXATED) for t in STAMPS)
    found = _numbers(replace(log, reachability=unfixated))
    assert found["reachable_share"] == 0
    assert found["degree_of_reach"] is None


def test_cells_of_the_table() -> None:
    assert [_cell(value) for value in (None, True, False, 9.96, 10.0, 123.4, 0.5)] == [
        *("–", "yes", "no", "9.96", "10", "123", "0.50")
    ]


def test_the_demo_writes_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three frames of each episode, a memory of one taxel, and a map where the right of the neck is reachable."""
    seeds = []

    def trained(world: World, trials: int, touch_every: int) -> PPSMemory:
        memory = PPSMemory.empty(world.skin)
        memory.counts[0, 2:4, 0, 0], memory.counts[1, 2, 0] = 25, (49, 99)  # the second has too few positive ones
        return memory

    def mapped(robot: object, side: str, rng: object, params: object) -> ReachableMap:
        lattice = Lattice(module._GAZE, (4, 4, 4))
        signed = lattice.gaze_rad[:, 0].reshape(lattice.shape)
        none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
        return ReachableMap(side, lattice.limits, signed, 0 * signed, 0 * signed, 1.0, 0.1, 0.0, none, 0)

    def short(world: World, episode: object, step: object, avoid: bool) -> object:
        seeds.append((episode.motion(0.0)[0].tolist(), avoid))  # type: ignore[attr-defined]
        return islice(whole(world, episode, step, avoid), 3)  # type: ignore[arg-type]

    whole = module.simulate
    for name, replaced in (("train", trained), ("train_reachable_map", mapped), ("simulate", short)):
        monkeypatch.setattr(module, name, replaced)
    shown: list[list[int]] = []
    landscapes = module.figures.landscapes
    monkeypatch.setattr(module.figures, "landscapes", lambda of, taxels: shown.append(taxels) or landscapes(of, taxels))
    demo(tmp_path / "out", trials=7, noise=2.0, seed=3)
    assert seeds[0] == (seeds[1][0], False)  # the same path with avoidance and without
    assert [avoid for _, avoid in seeds] == [False, True, True, True]
    assert seeds[2][0] != seeds[0][0]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["seed"], summary["trials"], summary["noise_grey_levels"]) == (3, 7, 2.0)
    assert {"pps-vision", "python", "numpy"} <= set(summary["versions"])
    assert list(summary["episodes"]) == [title for _, _, title in module._EPISODES]
    assert all(row["tracked_share"] == 0 for row in summary["episodes"].values())
    text = (tmp_path / "out" / "report.html").read_text()
    assert text.count("<video") == 1
    assert text.count("data:image/") >= 3
    assert "after 7 rendered approaches" in text
    assert shown == [[0]]
    assert "seed 3" in text
    with av.open(str(tmp_path / "out" / "demo.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == 6  # two and two beside each other
    assert load_memory(tmp_path / "out" / "memory.npz").counts.sum() == 50 + 148
    assert ReachableMap.load(tmp_path / "out" / "reach.npz").side == "left"
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 5
    assert said[0].split() == ["octopus", "approaching,", "avoidance", "off", "not", "touched", "arm", "still"]


def test_no_encounters_are_refused(refused) -> None:
    assert "--encounters 0; expected at least 1" in refused("demo", "--encounters", "0", "--out", "never")
