"""A recording of which nothing is tracked, or wrongly: `track` says why, and what to try."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import store
from videos import encode

from pps_vision.app.cli import main
from pps_vision.app.cli.options import RecordingSource
from pps_vision.app.diagnosis import diagnose
from pps_vision.app.track import track
from pps_vision.app.track_files import diagnosis_of, summary
from pps_vision.app.track_statistics import PathStatistics
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.severity.inputs import Shot
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import transform
from pps_vision.recordings.recording import Recording
from pps_vision.types import StereoFrame

K = np.array([[300.0, 0, 159.5], [0, 300, 119.5], [0, 0, 1]])
N = 16


def every_image(rec: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for file in rec.rglob("*.ppm"):
        cv2.imwrite(str(file), change(cv2.imread(str(file))))


def in_radians(rec: Path) -> None:
    for log in (rec / port / "data.log" for port in ("head", "torso", "left_arm", "right_arm")):
        rows = np.loadtxt(log)
        np.savetxt(log, np.c_[rows[:, :2], np.deg2rad(rows[:, 2:])], "%.9f")


def same_in_both_eyes(rec: Path) -> None:
    for file in (rec / "cam" / "left").glob("*.ppm"):
        shutil.copy(file, rec / "cam" / "right" / file.name)


def exchanged_eyes(rec: Path) -> None:
    for source, target in (("left", "temporary"), ("right", "left"), ("temporary", "right")):
        (rec / "cam" / source).rename(rec / "cam" / target)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rec = tmp_path_factory.mktemp("short") / "rec"
    words = "--stimulus ball --motion circle --seconds 1 --noise 2 --seed 3"
    main(["render", *words.split(), "--out", str(rec)])
    return rec


def diagnosis(tmp_path: Path, capsys, *words: object) -> dict:
    """What `track` writes; the same must stand on the terminal."""
    capsys.readouterr()
    main(["track", *map(str, words), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    written: dict = json.loads((tmp_path / "out" / "summary.json").read_text())["diagnosis"]
    assert all(f"  try {line}" in printed for line in written["advice"])
    assert f"searched {written['counts'].get('frames', 0)} frames" in printed
    return written


@pytest.mark.parametrize(
    ("damage", "advice"),
    [
        (in_radians, "joints in degrees"),
        (exchanged_eyes, "--left and --right exchanged, or the folders cam/left and cam/right"),
        (same_in_both_eyes, "left and right are the same in every frame"),
        (lambda rec: every_image(rec, lambda image: image // 24), "more light or exposure: the mean grey level is 3."),
        (lambda rec: every_image(rec, lambda image: np.full_like(image, 90)), "every frame is dark, plain or the same"),
    ],
)
def test_a_fault_of_the_recording(rendered, tmp_path, capsys, damage, advice):
    shutil.copytree(rendered, tmp_path / "rec")
    damage(tmp_path / "rec")
    assert any(advice in line for line in diagnosis(tmp_path, capsys, tmp_path / "rec")["advice"])


def test_a_wrong_mode(rendered, tmp_path, capsys):
    written = diagnosis(tmp_path, capsys, rendered, "--mode", "marker")
    assert written["advice"] == ["--mode generic: no blob of the marker's green is in both images"]
    assert {"candidates_left": 0, "candidates_right": 0}.items() <= written["counts"].items()
    assert written["counts"]["frames"] >= 18  # of 20; where the cameras' poses are in doubt nothing is searched


def test_what_is_tracked_needs_no_diagnosis_and_has_a_size(rendered, tmp_path, capsys):
    main(["track", str(rendered), "--out", str(tmp_path / "out")])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "diagnosis" not in summary
    radius_m = np.genfromtxt(rendered / "truth.csv", delimiter=",", names=True)["radius_m"][0]
    size = summary["object"]
    assert size["low_95_m"] < 2 * radius_m < size["high_95_m"]
    assert size["diameter_m"] == pytest.approx(2 * radius_m, rel=0.1)
    assert f"object {1000 * size['diameter_m']:.3g} mm across (95 %: " in capsys.readouterr().out


def drawn(
    folder: Path, disparity_px: float, wall: Callable[[int], np.ndarray], radius_px: int = 14, baseline_m: float = -0.1
) -> list[object]:
    """Images of fixed cameras: a red ball that moves 4 px a frame before a wall, with options for `track`."""
    store(folder / "c.yml", K1=K, K2=K, R=np.eye(3), T=np.array([baseline_m, 0, 0]))
    for k in range(N):
        for side, shift in (("L", 0.0), ("R", -disparity_px)):
            image = wall(k).copy()
            at = (round(16 * (100 + 4 * k + shift)), round(16 * 120.0))
            cv2.circle(image, at, 16 * radius_px, (30, 30, 220), -1, cv2.LINE_AA, 4)
            cv2.imwrite(str(folder / f"{side}{k:03d}.png"), image)
    return ["--left", folder / "L*.png", "--right", folder / "R*.png", "--fps", 20, "--calib", folder / "c.yml"]


@cache
def texture(blur_px: float = 4.0) -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 255, (240, 320 + 200, 3), np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), blur_px)
    return cv2.normalize(smooth, np.empty_like(smooth), 0, 255, cv2.NORM_MINMAX)


def still(k: int) -> np.ndarray:
    return texture()[:, :320]


def turning(k: int) -> np.ndarray:
    return texture()[:, 6 * k : 6 * k + 320]


@pytest.mark.parametrize(
    ("scene", "advice"),
    [
        ((-40.0, still), "--left and --right exchanged"),  # the ball is seen behind the cameras
        ((40.0, still, 14, -100.0), "another calibration or --unit-m: the cameras are 100 m apart"),
        ((40.0, turning, 1), "the whole image changes from frame to frame"),
    ],
)
def test_fixed_cameras(tmp_path, capsys, scene, advice):
    written = diagnosis(tmp_path, capsys, *drawn(tmp_path, *scene))
    assert any(advice in line for line in written["advice"])


@pytest.mark.parametrize("baseline_m", [1e300, 0.0])
def test_cameras_at_an_impossible_distance_are_refused(tmp_path, baseline_m, refused):
    words = drawn(tmp_path, 40.0, still, baseline_m=-baseline_m)
    line = refused("track", *words, "--out", tmp_path / "out")
    assert "c.yml: T is " in line


LEFT = {"frames": 20, "motion_left": 5}
BOTH = LEFT | {"motion_right": 4}


@pytest.mark.parametrize(
    ("counts", "advice"),
    [
        ({}, "other images: every frame is dark, plain or the same"),
        ({"frames": 20}, "--mode marker for a green marker, or a faster object"),
        (LEFT, "the calibration and the order of the images"),
        (BOTH | {"candidates_left": 3}, "an object whose colours stand out"),
        (BOTH | {"candidates_left": 3, "candidates_right": 2}, "a longer recording: candidates were found"),
        (BOTH | {"rejected by colour": 2, "rejected by size": 1}, "the same exposure and white balance"),
        (BOTH | {"rejected by colour": 2, "rejected by size": 3}, "an object that both cameras see whole"),
        (BOTH | {"rejected by disparity": 2}, "--left and --right exchanged, or another calibration: candidates are "),
    ],
)
def test_the_counts_of_the_search_name_one_thing_to_try(counts, advice):
    diagnosis = diagnose(plain_pairs(), "generic", counts, 0.0, (0.0, 0.0), 0.0)
    assert diagnosis is not None
    assert [line[: len(advice)] for line in diagnosis.advice] == [advice]


@pytest.mark.parametrize(("wall", "shift_px"), [(still, None), (turning, 6.0)])
def test_cameras_that_move_are_seen_in_a_few_images(tmp_path, capsys, wall, shift_px):
    words = drawn(tmp_path, 40.0, wall)
    main(["info", *map(str, words), "--json"])
    warnings = [text for text in json.loads(capsys.readouterr().out)["warnings"] if "px a frame" in text]
    assert len(warnings) == (shift_px is not None)
    if shift_px:
        assert float(warnings[0].split("shift by ")[1].split()[0]) == pytest.approx(shift_px, abs=0.1)


def test_a_wide_video_of_one_camera_is_not_taken_for_two(rendered, tmp_path, capsys):
    """Its calibration (OpenCV's form) does not say how large the images are."""
    store(tmp_path / "calib.yml", K1=K, K2=K, R=np.eye(3), T=np.array([-0.068, 0, 0]))
    left, right = (
        [cv2.imread(str(file)) for file in sorted((rendered / "cam" / eye).glob("*.ppm"))] for eye in ("left", "right")
    )
    for name, images in (
        ("both", [np.hstack(pair) for pair in zip(left, right, strict=True)]),
        ("one", [cv2.resize(image, None, fx=2, fy=1) for image in left]),
    ):
        encode(tmp_path / f"{name}.mp4", (image[..., ::-1] for image in images), 20)
        capsys.readouterr()
        main(["info", str(tmp_path / f"{name}.mp4"), "--calib", str(tmp_path / "calib.yml"), "--json"])
        warnings = json.loads(capsys.readouterr().out)["warnings"]
        assert any("continue each other" in warning for warning in warnings) == (name == "one")


@pytest.mark.parametrize(
    ("step_s", "moving", "advice"),
    [
        (0.05, 0, "--mode marker for a green marker, or a faster object: nothing moves against the scene"),
        (0.05, 3, "a larger object, nearer or of more contrast: what changes in the images is too little"),
        (1e-5, 3, "--times-unit, --fps or other stamps: there are 1e+05 pairs/s, too many, if the stamps are right"),
        (33.3, 3, "--times-unit, --fps or other stamps: there are 0.03 pairs/s, too few to follow a motion"),
    ],
)
def test_that_nothing_moves_is_said_only_where_nothing_moves(step_s, moving, advice):
    diagnosis = diagnose(plain_pairs(step_s, moving), "generic", {"frames": 20}, 0.0, (0.0, 0.0), 0.0)
    assert diagnosis is not None
    assert [line[: len(advice)] for line in diagnosis.advice] == [advice]


def plain_pairs(step_s: float = 1.0, moving: int = 0) -> Recording:
    """Plain pairs, whose images differ by a pixel, and by a square of `moving` pixels."""
    camera = Camera(40, 30, 30.0, 30.0, 19.5, 14.5)
    images = np.full((2, 30, 40, 3), 90, np.uint8)
    images[1, 0, 0] += 1
    images[1, 10 : 10 + moving, 10 : 10 + moving] = 250
    pairs = [
        tuple(
            Shot(Path(f"{side}.png"), k * step_s, pixels=images[k] + np.uint8(i) if moving else images[i])
            for i, side in enumerate(("left", "right"))
        )
        for k in range(2)
    ]
    rig = StereoRig.fixed(camera, camera, transform(translation=(0.1, 0.0, 0.0)))
    return Recording("made up", tuple(pairs), (40, 30), [], rig=rig)


def test_the_frames_of_the_diagnosis_are_not_read_again(crossing, tmp_path, monkeypatch):
    """One image is read before, for its depth."""
    rig, frames = crossing
    read = []
    monkeypatch.setattr(Shot, "load", lambda self: read.append(self.path) or self.pixels)
    sides = ("left", "right")
    pairs = tuple(
        tuple(Shot(Path(f"{side}{k}.png"), k / 30, pixels=getattr(frame, side)) for side in sides)
        for k, frame in enumerate(frames[:N])
    )
    recording = Recording("made up", pairs, (320, 240), [], rig=rig)
    monkeypatch.setattr(RecordingSource, "open", lambda self: recording)
    main(["track", "made up", "--out", str(tmp_path / "out")])
    assert len(read) == 2 * N + 1


@pytest.fixture(scope="module")
def crossing() -> tuple[StereoRig, list[StereoFrame]]:
    """A ball that crosses the view obliquely, 30 cm/s, 60 cm away."""
    film = Film(FilmScene(width=320, height=240, seconds=2.0, motion="straight"), seed=11)
    return film.rig, list(film)


@pytest.mark.parametrize(("late", "off_px", "warned"), [(0, 0.0, False), (6, 0.0, True), (0, 8.0, True)])
def test_left_and_right_of_different_moments_or_a_wrong_calibration(crossing, late, off_px, warned):
    """One eye is 0.2 s late, or the calibration's rows are 8 px off; either is told without saying which it is."""
    rig, frames = crossing
    pairs = tuple(
        (Shot(Path("left.png"), k / 30, pixels=left.left), Shot(Path("right.png"), k / 30, pixels=right.right))
        for k, (left, right) in enumerate(zip(frames[late:], frames, strict=False))
    )
    rig = StereoRig(rig.left, replace(rig.right, cy=rig.right.cy + off_px), rig.eye_poses)
    run = track(Recording("crossing", pairs, (320, 240), [], rig=rig))
    numbers = PathStatistics()
    for pair in run.tracked_pairs(run):
        numbers.add(pair.track, pair.residual_px)
    diagnosis = diagnosis_of(run, numbers)
    assert numbers.tracked_share > 0.4
    assert (numbers.residual_px > 1.0) == warned == (diagnosis is not None)
    assert summary(run, numbers)["residual_px"] == numbers.residual_px
    if diagnosis:
        *by_points, advice = diagnosis.advice
        assert advice.startswith("another calibration, or left and right images of the same moment: what is tracked")
        assert len(by_points) == (off_px > 0)
        for line in by_points:
            assert float(line.split("fit the cameras only within ")[1].split()[0]) == pytest.approx(8.0, abs=0.5)
