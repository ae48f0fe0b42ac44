"""From `render` to `track`: the files, their columns, and the numbers against the scene's own truth."""

import csv
import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from scipy.stats import chi2

from control.fixation import fixation_error
from learning.pps.memory import PPSMemory, save_memory
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice, isotropic
from learning.reach.map import ReachableMap
from pps_vision.app.cli import main
from pps_vision.app.render import scene
from pps_vision.app.render_params import RenderParams
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.robot_file import robot_setup
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import icub_skin


def table(file: Path) -> dict[str, np.ndarray]:
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.fixture(scope="module")
def tracked(approach: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tracked") / "out"
    main(["track", str(approach), "--out", str(out), "--video"])
    return out


@pytest.fixture
def memory_of_12_cm(tmp_path: Path) -> Path:
    """As if all that came within 12 cm of a taxel had touched it."""
    memory = PPSMemory.empty(icub_skin())
    distance_m = np.linspace(*memory.params.distance_range_m, memory.params.bins[0], endpoint=False)
    counts = np.zeros_like(memory.counts)
    counts[:, (distance_m >= 0) & (distance_m < 0.12), ..., 0] = 20
    save_memory(tmp_path / "memory.npz", replace(memory, counts=counts))
    return tmp_path / "memory.npz"


def test_the_same_seed_renders_the_same_recording(tmp_path):
    for name in ("a", "b"):
        words = "--stimulus cube --motion figure8 --seconds 0.2 --noise 3 --seed 4"
        main(["render", *words.split(), "--out", str(tmp_path / name)])
    for file in sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_tracking_writes_what_it_promises(tracked):
    files = {p.name for p in tracked.iterdir()}
    assert files == {"detections.csv", "overlay.mp4", "summary.json", "trajectory.csv"}
    film = cv2.VideoCapture(str(tracked / "overlay.mp4"))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == 48
    summary = json.loads((tracked / "summary.json").read_text())
    assert {"q25_ms", "median_ms", "q75_ms"} <= set(summary["ms_per_pair"]["total"])
    assert summary["skipped"] == dict.fromkeys(summary["skipped"], 0)


def test_the_path_is_the_true_one(tracked, approach):
    path = table(tracked / "trajectory.csv")
    truth = table(approach / "truth.csv")
    tracked_rows = path["status"] == "tracking"
    assert tracked_rows[10:].mean() >= 0.97
    error = np.stack(
        [path[c][tracked_rows].astype(float) - truth[c][tracked_rows].astype(float) for c in ("x_m", "y_m", "z_m")], 1
    )
    rms = np.sqrt((error**2).sum(axis=1).mean())
    assert rms <= 0.005
    written = json.loads((tracked / "summary.json").read_text())["errors"]["position_rms_mm"]
    late = tracked_rows & (np.arange(len(tracked_rows)) >= 10)
    assert written == pytest.approx(1000 * np.sqrt((error[late[tracked_rows]] ** 2).sum(axis=1).mean()), rel=1e-6)


def test_with_a_map_every_frame_says_whether_the_hand_gets_there(approach, tmp_path):
    """The map calls reachable what needs a larger vergence than the ball in frame 25 of 45; the ball comes nearer."""
    shutil.copytree(approach, tmp_path / "rec")
    for side in ("left", "right"):
        log = tmp_path / "rec" / "cam" / side / "data.log"
        log.write_text("\n".join(log.read_text().splitlines()[:45]))
    lattice = Lattice(GazeLimits(pitch_rad=(-1.4, 0.7)), (3, 3, 9))
    truth = table(approach / "truth.csv")
    ball_m = np.array([[float(truth[name][25]) for name in ("x_m", "y_m", "z_m")]])
    border = gaze_for_points(load_icub(), ball_m, lattice.limits)[0, 2]
    signed = (isotropic(lattice.gaze_rad) - isotropic(np.array([0, 0, border])))[:, 2].reshape(lattice.shape)
    none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    reachable_map = ReachableMap(
        "left", lattice.limits, signed, 0.5 + 0 * signed, 0.1 + 0 * signed, 0.4, 1e-4, 0.0, none, 0
    )
    reachable_map.save(tmp_path / "map.npz")
    main(["track", str(tmp_path / "rec"), "--map", str(tmp_path / "map.npz"), "--out", str(tmp_path / "out")])
    path = table(tmp_path / "out" / "trajectory.csv")
    names = ["gaze_yaw_deg", "gaze_pitch_deg", "gaze_vergence_deg", "reach_probability", "reach_degree", "reach_status"]
    assert list(path)[-6:] == names
    located = np.isin(path["status"], ["tracking", "coasting"])
    assert (path["reach_status"][~located] == "unknown").all()
    assert all((path[name][~located] == "").all() for name in ("gaze_yaw_deg", "reach_degree"))
    gaze, xyz = (
        np.stack([path[name][located].astype(float) for name in group], axis=1)
        for group in (names[:3], ("x_m", "y_m", "z_m"))
    )
    np.testing.assert_allclose(fixation_points(load_icub(), np.deg2rad(gaze)), xyz, atol=1e-6)
    said = path["reach_status"][located]
    assert (said == np.where(gaze[:, 2] > np.rad2deg(border), "reachable", "unreachable")).all()
    assert set(said) == {"reachable", "unreachable"}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["map"] == str(tmp_path / "map.npz")
    assert summary["reach"]["reachable"] == int((said == "reachable").sum())
    assert summary["reach"]["unknown"] == int((~located).sum())


def test_with_a_memory_every_frame_says_what_is_about_to_be_touched(approach, tmp_path, memory_of_12_cm):
    main(["track", str(approach), "--memory", str(memory_of_12_cm), "--report", "--out", str(tmp_path / "out")])
    felt = table(tmp_path / "out" / "activation.csv")
    truth = table(approach / "truth.csv")
    assert list(felt) == ["stamp_s", *icub_skin().taxel_ids]
    np.testing.assert_allclose(felt["stamp_s"].astype(float), truth["stamp_s"].astype(float), atol=1e-6)
    rows = (approach / "skin" / "data.log").read_text().splitlines()
    first_touch_s = min(float(row.split()[1]) for row in rows if "left_forearm:3" in row)
    before_s = first_touch_s - felt["stamp_s"].astype(float)
    activation = felt["left_forearm:3"].astype(float)
    near = (before_s > 0) & (before_s < 0.5)  # at 12 cm/s, within 6 cm
    assert (activation[near] > 0.4).all()
    assert (activation[before_s > 1.5] < 0.4).all()
    assert not felt["right_forearm:3"].astype(float).any()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Activation over the body" in page
    first, last = (cv2.imread(str(tmp_path / "out" / "keyframes" / f"{k}.jpg")) for k in (0, 4))
    red = [int(((image[..., 2] > 220) & (image[..., :2].max(axis=2) < 60)).sum()) for image in (first, last)]
    assert red[1] > red[0] + 50  # taxels that expect a touch


@pytest.mark.parametrize("reduction", [1, 2])
def test_detections_are_where_the_centre_truly_projects(reduction, tracked, approach, tmp_path):
    out = tracked
    if reduction > 1:
        out = tmp_path / "out"
        main(["track", str(approach), "--reduction", str(reduction), "--out", str(out)])
        assert json.loads((out / "summary.json").read_text())["reduction"] == reduction
    detections = table(out / "detections.csv")
    truth = table(approach / "truth.csv")
    for camera in ("left", "right"):
        of_camera = detections["camera"] == camera
        frame = detections["frame"][of_camera].astype(int)
        du = detections["u_px"][of_camera].astype(float) - truth[f"u_{camera}_px"][frame].astype(float)
        dv = detections["v_px"][of_camera].astype(float) - truth[f"v_{camera}_px"][frame].astype(float)
        assert np.median(np.hypot(du, dv)) < 0.3 * reduction


def test_what_is_bad_in_one_frame_does_not_stop_the_others(approach, tmp_path, capsys):
    broken = tmp_path / "broken"
    shutil.copytree(approach, broken)
    (broken / "cam" / "left" / "00000040.ppm").write_bytes(b"P6\n320 240\n255\n")
    log = broken / "cam" / "left" / "data.log"
    rows = log.read_text().splitlines()
    rows[6] = " ".join([rows[6].split()[0], rows[5].split()[1], rows[6].split()[2]])  # a stamp that comes again
    log.write_text("\n".join(rows))
    head = broken / "head" / "data.log"
    lines = head.read_text().splitlines()
    lines[20] = " ".join([*lines[20].split()[:2], "nan", *lines[20].split()[3:]])
    lines[30] = "what is this"
    head.write_text("\n".join(lines) + "\n")
    main(["track", str(broken), "--out", str(tmp_path / "out")])
    said = capsys.readouterr().err
    assert "00000040.ppm" in said
    assert "head/data.log:21" in said
    assert "head/data.log:31" in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["frames"] == len(open_recording(approach)) - 2
    assert (summary["skipped"]["bad_image"], summary["skipped"]["backwards_stamp"]) == (1, 1)
    assert summary["skipped"]["bad_joints"] + summary["skipped"]["bad_row"] == 2


SETUP = robot_setup(None)


@pytest.mark.parametrize("fps", [5.0, 20.0])
def test_the_eyes_follow_the_object_while_the_head_sways(fps):
    """They begin on it; joints move on by their rates, and the object by its velocity."""
    params = RenderParams("ball", "circle", Path("never"), seconds=2.0, fps=fps, speed=0.1)
    rendered = list(scene(params, SETUP, np.random.default_rng(1)))
    assert [t for t, _ in rendered] == pytest.approx(np.arange(0, 2, 1 / fps))
    errors = [fixation_error(SETUP.robot.at(state.q_rad), state.position) for _, state in rendered]
    assert errors[0] < 1e-3
    assert np.rad2deg(max(errors)) < (1.5 if fps == 20 else 5)
    for (_, state), (_, following) in pairwise(rendered):
        assert state.dq_rad_s is not None
        np.testing.assert_allclose(following.q_rad, SETUP.robot.clamp(state.q_rad + state.dq_rad_s / fps), atol=1e-12)
        assert state.position is not None
        np.testing.assert_allclose(following.position, state.position + state.velocity / fps, atol=0.1 / fps)
    q = np.array([state.q_rad for _, state in rendered])
    assert np.ptp(q[:, SETUP.robot.indices(("neck_yaw",))[0]]) > np.deg2rad(3)


def test_in_batches_the_path_is_the_same(tmp_path):
    recording = tmp_path / "recording"
    words = "--stimulus marker --motion circle --seconds 0.6 --noise 2 --seed 3"
    main(["render", *words.split(), "--out", str(recording)])
    for name, device in (("alone", []), ("batches", ["--device", "cpu"])):
        main(["track", str(recording), "--mode", "marker", *device, "--out", str(tmp_path / name)])
        total = json.loads((tmp_path / name / "summary.json").read_text())["ms_per_pair"]["total"]
        assert total["runs"] == 12
    paths = [table(tmp_path / name / "trajectory.csv") for name in ("alone", "batches")]
    alone, batches = ([[float(x or "nan") for x in path[c]] for c in ("x_m", "y_m", "z_m")] for path in paths)
    assert np.isfinite(alone)[:, 4:].all()
    assert np.allclose(alone, batches, rtol=0, atol=1e-4, equal_nan=True)


def test_what_it_cannot_do_is_refused(approach, tmp_path, refused):
    out = ("--out", tmp_path / "out")
    images = ("--left", "a*.png", "--right", "b*.png", "--calib", "c.yml")
    for option in ("--map", "--memory"):
        assert f"{option} a.npz with --left" in refused("track", *images, option, "a.npz", *out)
    assert "--device tpu" in refused("track", approach, "--device", "tpu", *out)
    missing = f"cuda:{torch.cuda.device_count()}"
    line = refused("track", approach, "--device", missing, *out)
    assert f"--device {missing}" in line
    assert "expected cpu" in line


def test_what_a_hand_may_hide_of_an_object_is_in_its_covariance(tmp_path):
    """An octopus, parts of which a hand hides: more than half a centimetre off, and said so."""
    words = "--stimulus octopus --motion approach --carrier hand --seconds 1.2 --seed 7"
    main(["render", *words.split(), "--out", str(tmp_path / "rec")])
    main(["track", str(tmp_path / "rec"), "--one", "--out", str(tmp_path / "out")])
    path = table(tmp_path / "out" / "trajectory.csv")
    truth = table(tmp_path / "rec" / "truth.csv")
    known = path["status"] == "tracking"
    off = np.stack([path[c][known].astype(float) - truth[c][known].astype(float) for c in ("x_m", "y_m", "z_m")], 1)
    cov = np.empty((len(off), 3, 3))
    for i, j in np.ndindex(3, 3):
        cov[:, i, j] = path[f"cov_{'xyz'[min(i, j)]}{'xyz'[max(i, j)]}_m2"][known].astype(float)
    mahalanobis2 = np.einsum("ni,nij,nj->n", off, np.linalg.inv(cov), off)
    assert known.sum() > 15
    assert np.median(np.linalg.norm(off, axis=1)) < 0.025
    assert (mahalanobis2 < chi2.ppf(0.95, 3)).mean() > 0.9
