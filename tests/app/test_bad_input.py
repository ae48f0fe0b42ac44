"""Bad input ends in one line that names the fault, exit code 2, and no partial output."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from videos import write_video

from learning.pps.memory import PPSMemory, save_memory
from pps_vision.app.learn import learn_from
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.robot.skin import icub_skin


def test_no_such_recording(refused, tmp_path: Path) -> None:
    line = refused("track", tmp_path / "nowhere", "--out", tmp_path / "out")
    assert "nowhere" in line
    assert "nowhere" in refused("track", tmp_path / "nowhere", "--out", tmp_path / "new" / "folder" / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_without_a_calibration(refused, approach: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(approach, bare, ignore=shutil.ignore_patterns("icubEyes.ini"))
    assert "icubEyes.ini" in refused("track", bare, "--out", tmp_path / "out")
    assert "holds no calibration" in refused("truth", bare, "--aruco", 7, "--tag-mm", 48, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_is_learned_from_unreadable_recordings(refused, refused_with, tmp_path: Path) -> None:
    assert "gone" in refused("learn", tmp_path / "gone", "--out", tmp_path / "m.npz")
    lines = refused_with("learn", tmp_path / "gone", tmp_path / "lost", "--out", tmp_path / "m.npz")
    assert "gone" in lines[0]
    assert "lost" in lines[1]
    assert "none of 2 recordings" in lines[2]
    assert list(tmp_path.iterdir()) == []


def test_neither_or_both_kinds_of_input(refused, tmp_path: Path) -> None:
    assert "REC" in refused("track", "--out", tmp_path / "out")
    assert "REC" in refused("track", tmp_path, "--left", "a*", "--right", "b*", "--out", tmp_path / "out")
    images = ("--left", "a*", "--right", "b*")
    assert "--left a* without --right; expected both" in refused("track", *images[:2], "--out", tmp_path / "out")
    assert "matches no file" in refused("track", *images, "--calib", "c.yml", "--out", tmp_path / "out")


def test_an_unreadable_calibration_is_named_with_its_line(refused, approach: Path, tmp_path: Path) -> None:
    bad = tmp_path / "eyes.ini"
    bad.write_text("[CAMERA_CALIBRATION_LEFT]\nw 320\nh 240\nfx many\nfy 1\ncx 1\ncy 1\nk1 0\nk2 0\np1 0\np2 0\n")
    assert "eyes.ini:4" in refused("track", approach, "--calib", bad, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unwritable_output(refused, approach: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert "file" in refused("track", approach, "--out", tmp_path / "file")
    assert "file" in refused("render", "--stimulus", "ball", "--motion", "circle", "--out", tmp_path / "file")
    assert "file: is no folder; expected" in refused("batch", approach, "--out", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_an_output_that_is_not_empty_is_not_overwritten_by_a_recording(refused, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    assert "thesis.txt" in refused("render", "--stimulus", "ball", "--motion", "circle", "--out", tmp_path)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--seconds 0", "--seconds"),
        ("--fps -1", "--fps"),
        ("--center nan 0 0", "--center"),
        ("--noise -2", "noise"),
        ("--speed 0", "speed"),
        ("--radius 30", "--radius 30.0 m; expected above 0 and at most 0.3"),
        ("--noise 1e300", "noise_sigma = 1e+300; expected a number from 0 to 255"),
        ("--target left_forearm:4711", "left_forearm:4711"),
        ("--center 5 5 5", "in view"),
    ],
)
def test_render_names_what_it_cannot_do(refused, tmp_path: Path, words: str, named: str) -> None:
    out = tmp_path / "rec"
    assert named in refused("render", "--stimulus", "ball", "--motion", "circle", *words.split(), "--out", out)
    assert list(tmp_path.iterdir()) == []


def test_a_first_box_outside_the_image(refused, approach: Path, tmp_path: Path) -> None:
    args = ("track2d", approach / "cam" / "left", "--init", 300, 200, 90, 90, "--out", tmp_path / "b.csv")
    assert "320×240" in refused(*args)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_frames(refused, tmp_path: Path) -> None:
    init = ("--init", 1, 1, 9, 9, "--out", tmp_path / "b.csv")
    assert "no usable frame" in refused("track2d", tmp_path, *init)
    (tmp_path / "a.png").touch()
    assert "a.png: is no folder and no video; expected a folder with" in refused("track2d", tmp_path / "a.png", *init)
    assert "gone: no such folder" in refused("track2d", tmp_path / "gone", *init)


@pytest.mark.parametrize(
    "words",
    [
        "bench tracking --n 0 --out results",
        "bench loop --n 0 --out results",
        "demo --trials 0",
    ],
)
def test_experiments_on_nothing(refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    monkeypatch.chdir(tmp_path)
    assert "expected at least" in refused(*words.split())
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


def test_two_calibrations_for_one_recording(refused, approach: Path, tmp_path: Path) -> None:
    eyes = approach / "icubEyes.ini"
    assert "expected one" in refused("track", approach, "--calib", eyes, eyes, "--out", tmp_path / "out")


def test_a_memory_that_is_none(refused, tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    assert "other.npz" in refused("show", tmp_path / "other.npz", "--out", tmp_path / "f.png")
    assert "gone.npz" in refused("show", tmp_path / "gone.npz", "--out", tmp_path / "f.png")
    assert not (tmp_path / "f.png").exists()


@pytest.mark.parametrize("suffix", [".xyz", ""])
def test_a_figure_of_an_unknown_format(refused, tmp_path: Path, suffix: str) -> None:
    save_memory(tmp_path / "m.npz", PPSMemory.empty(icub_skin(("left_palm",))))
    line = refused("show", tmp_path / "m.npz", "--out", tmp_path / f"figure{suffix}")
    assert f"figure{suffix}: has the suffix '{suffix}'; expected one of ." in line
    assert [p.name for p in tmp_path.iterdir()] == ["m.npz"]


@pytest.mark.parametrize(
    "words",
    [
        "track2d FOLDER --init 1 1 9 9 --out FOLDER/a.png",
        "learn FOLDER --out FOLDER/head/data.log",
        "learn FOLDER --into FILE --out FILE",
        "joints FOLDER --out FOLDER/head/data.log",
        "joints FOLDER --calib FILE --out FILE",
        "show FILE --out FILE",
        "convert-taxels OTHER FILE --like FILE",
        "reach query FILE OTHER --out FILE",
        "reach query OTHER FILE --out FILE",
        "reach show FILE --out FILE",
        "reach train --arm left --into FILE --out FILE",
        "track FOLDER --out FOLDER",
        "render --stimulus ball --motion circle --out FOLDER",
        "demo --out FOLDER",
    ],
)
def test_no_command_writes_over_what_it_reads(refused, tmp_path: Path, words: str) -> None:
    folder, file, second = tmp_path / "rec", tmp_path / "file.ini", tmp_path / "other.npz"
    (folder / "head").mkdir(parents=True)
    contents = {folder / "a.png": "mine", folder / "head" / "data.log": "mine", file: "mine", second: "mine"}
    for place, text in contents.items():
        place.write_text(text)
    places = {"FOLDER": str(folder), "FILE": str(file), "OTHER": str(second)}
    for name, place in places.items():
        words = words.replace(name, place)
    line = refused(*words.split())
    assert "which is read" in line or f"{folder}: already holds a.png" in line
    assert {place: place.read_text() for place in contents} == contents
    assert sorted(p for p in tmp_path.rglob("*") if p.is_file()) == sorted(contents)


def test_a_first_box_in_an_image_that_cannot_be_read(refused, approach: Path, tmp_path: Path) -> None:
    shutil.copytree(approach / "cam" / "left", tmp_path / "frames")
    first = min((tmp_path / "frames").glob("*.p*m"))
    first.write_bytes(b"")
    line = refused("track2d", tmp_path / "frames", "--init", 100, 100, 20, 20, "--out", tmp_path / "boxes.csv")
    assert first.name in line
    assert "--init is the box in that image" in line


def test_nothing_to_learn_from(refused, tmp_path: Path) -> None:
    assert "no recording" in refused("learn", "--out", tmp_path / "m.npz")
    assert not (tmp_path / "m.npz").exists()


def test_python_control_beside_us_is_refused(refused, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "control-0.10.2.dist-info").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "python-control" in refused("track2d", tmp_path, "--init", 1, 1, 9, 9, "--out", tmp_path / "b.csv")


def test_a_stimulus_that_is_neither_known_nor_a_mesh(refused, tmp_path: Path) -> None:
    (tmp_path / "half.ply").write_text("ply\n")
    for stimulus, named in (("whale", "marker, ball, cube, octopus, FILE.stl"), (tmp_path / "half.ply", "half.ply: ")):
        assert named in refused("render", "--stimulus", stimulus, "--motion", "circle", "--out", tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_what_needs_a_robot_or_one_of_its_parts(refused, tmp_path: Path, calib: Path) -> None:
    """Videos have none; the arm of seven joints is a right one, and its cameras are not the iCub's."""
    write_video(tmp_path / "a.mp4", [0.0, 0.05])
    arm7, out = ("--robot", Path(__file__).parents[1] / "arm7" / "robot.toml"), ("--out", tmp_path / "out")
    video = tmp_path / "a.mp4", "--calib", calib, *out
    assert "without a robot; expected it with an iCub's REC" in refused("track", *video, "--memory", tmp_path / "m.npz")
    recording = open_recording(tmp_path / "a.mp4", calib=[calib])
    with pytest.raises(InputError, match="has no joints; expected the recording of a robot"):
        learn_from(recording, PPSMemory.empty(icub_skin()))
    assert "has no left_arm; expected --arm right" in refused("reach", "train", *arm7, "--arm", "left", *out)
    assert "--motion circle without --center" in refused(
        "render", *arm7, "--stimulus", "ball", "--motion", "circle", "--target", "forearm:4", *out
    )
    save_memory(tmp_path / "m.npz", PPSMemory.empty(icub_skin()))
    assert "m.npz" in refused("show", tmp_path / "m.npz", *arm7, "--out", tmp_path / "m.png")
    assert not (tmp_path / "out").exists()
