"""The demo with training and episodes cut short, and the demo of encounters (its full run in make test-all)."""

import json
from dataclasses import replace
from itertools import islice

import av
import cv2
import numpy as np
import pytest

from learning.pps.memory import PPSMemory, load_memory
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice
from learning.reach.map import ReachableMap
from pps_vision.app import demo as module
from pps_vision.app.demo import demo, demo_encounters
from pps_vision.app.simulation import SimulationScene, log_of, make_episode, new_pipeline, open_scene, simulate


def test_the_demo_writes_its_report(tmp_path, monkeypatch, capsys):
    """Three frames of each episode, a memory of one taxel, and a map where the right of the neck is reachable."""
    seeds = []

    def trained(scene: SimulationScene, trials: int, touch_every: int) -> PPSMemory:
        memory = PPSMemory.empty(scene.skin)
        memory.counts[0, 2:4, 0, 0, 0] = 25
        memory.counts[1, 2, 0, 0] = 49, 99  # too few positive samples
        return memory

    def mapped(robot: object, side: str, rng: object, params: object) -> ReachableMap:
        lattice = Lattice(module._GAZE, (4, 4, 4))
        signed = lattice.gaze_rad[:, 0].reshape(lattice.shape)
        none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
        return ReachableMap(side, lattice.limits, signed, 0 * signed, 0 * signed, 1.0, 0.1, 0.0, none, 0)

    def short(scene: SimulationScene, episode: object, step: object, avoid: bool) -> object:
        seeds.append((episode.motion(0.0)[0].tolist(), avoid))
        rows = islice(whole(scene, episode, step, avoid), 3)
        if "receding" in episode.title or not avoid:  # from the second frame on the robot is 2° off
            rows = (replace(row, step=replace(row.step, mismatch_rad=0.035 * (k > 0))) for k, row in enumerate(rows))
        return rows

    def naive(scene: SimulationScene, seed: int) -> dict[str, object]:
        return {title: new_pipeline(scene, PPSMemory.empty(scene.skin)).step for title in module._ERRING}

    whole = module.simulation.simulate
    monkeypatch.setattr(module.simulation, "train", trained)
    monkeypatch.setattr(module.simulation, "simulate", short)
    monkeypatch.setattr(module, "train_reachable_map", mapped)
    monkeypatch.setattr(module, "erring_robots", naive)
    demo(tmp_path / "out", trials=7, noise=2.0, seed=3)
    assert seeds[0] == (seeds[1][0], False)  # the same path with avoidance and without
    assert [avoid for _, avoid in seeds] == [False, *5 * [True]]
    assert seeds[4] == seeds[5]  # the same path before and after learning
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["seed"], summary["trials"], summary["noise_grey_levels"]) == (3, 7, 2.0)
    assert {"pps-vision", "python", "numpy"} <= set(summary["versions"])
    assert list(summary["episodes"]) == [*(title for _, _, title in module._EPISODES), *module._ERRING]
    assert all(row["tracked_share"] == 0 for row in summary["episodes"].values())
    off = [row["mismatch_deg"] for row in summary["episodes"].values()]
    assert off == pytest.approx([0.0, 0.0, np.rad2deg(0.035), 0.0, 0.0, 0.0])  # nothing where the arm is not to obey
    text = (tmp_path / "out" / "report.html").read_text()
    assert "posture off its prediction" in text
    assert text.count("<video") == 1
    assert text.count("data:image/") >= 3
    assert "after 7 rendered approaches" in text
    assert "seed 3" in text
    assert "pps-vision demo --trials 7 --noise 2 --seed 3" in text
    assert cv2.imread(str(tmp_path / "out" / "demo.png")).shape == (480, 2 * 640, 3)
    with av.open(str(tmp_path / "out" / "demo.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == 9  # two and two beside each other
    assert load_memory(tmp_path / "out" / "memory.npz").counts.sum() == 50 + 148
    assert ReachableMap.load(tmp_path / "out" / "reach.npz").side == "left"
    printed = capsys.readouterr()
    assert {"reachable space: 0 of 1 after 00:00", "episodes: 0 of 6 after 00:00"} <= set(printed.err.splitlines())
    said = printed.out.splitlines()
    assert len(said) == 7
    assert said[6] == f"→ {tmp_path / 'out' / 'report.html'}"
    assert said[0].split() == ["octopus", "approaching,", "avoidance", "off", "not", "touched", "arm", "still"]
    assert said[2].endswith("still, up to 2.0° off the predicted posture from 0.1 s on")
    assert sum("off the predicted posture" in line for line in said) == 1


@pytest.mark.long
def test_a_robot_that_errs_is_touched_before_it_has_learned_and_not_after():
    outcomes = []
    with open_scene(2.0, 0) as scene:
        for policy in module.erring_robots(scene, 0).values():
            episode = make_episode("approach", scene, module._PALM, "octopus", np.random.default_rng((0, 0)), 0.10)
            outcomes.append(log_of(scene, episode, simulate(scene, episode, policy)))
    before, after = outcomes
    assert before.was_touched
    assert before.activations[~before.touched.any(axis=1)].max() == 0
    assert not after.was_touched
    assert after.activations.max(axis=1)[after.arm_commanded][0] >= 0.6


@pytest.mark.long
def test_a_report_of_one_encounter(tmp_path):
    demo_encounters(tmp_path / "out", 1, 2.0, 7, share=0.1)
    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text())["encounters"]
    assert not row["touched"]
    text = (tmp_path / "out" / "report.html").read_text()
    assert text.count("<video") == 1
    assert row["encounter"] in text
