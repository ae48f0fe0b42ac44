"""Bad input ends in one line that names the fault, exit code 2, and no partial output."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from data import ARM7
from videos import write_video

from learning.pps.memory import PPSMemory, save_memory
from pps_vision.app.learn import learn_from
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.skin import icub_skin

RENDER = "render --stimulus ball --motion circle --out TMP/rec"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("track TMP/nowhere --out TMP/new/folder/out", "nowhere"),
        ("track --out TMP/out", "REC"),
        ("track TMP --left a* --right b* --out TMP/out", "REC"),
        ("track --left a* --out TMP/out", "--left a* without --right; expected both"),
        ("track --left a* --right b* --calib c.yml --out TMP/out", "matches no file"),
        ("track REC --calib REC/icubEyes.ini REC/icubEyes.ini --out TMP/out", "expected one"),
        ("track2d REC/cam/left --init 300 200 90 90 --out TMP/b.csv", "320×240"),
        ("track2d TMP --init 1 1 9 9 --out TMP/b.csv", "no usable frame"),
        ("track2d TMP/gone --init 1 1 9 9 --out TMP/b.csv", "gone: no such folder"),
        ("track2d REC/truth.csv --init 1 1 9 9 --out TMP/b.csv", "is no folder and no video; expected a folder with"),
        ("learn --out TMP/m.npz", "no recording"),
        ("learn TMP/gone --out TMP/m.npz", "gone"),
        ("show TMP/gone.npz --out TMP/f.png", "gone.npz"),
        ("show REC/truth.csv --out TMP/f.png", "truth.csv"),
        (f"{RENDER} --seconds 0", "--seconds"),
        (f"{RENDER} --fps -1", "--fps"),
        (f"{RENDER} --center nan 0 0", "--center"),
        (f"{RENDER} --center 5 5 5", "in view"),
        (f"{RENDER} --noise -2", "noise"),
        (f"{RENDER} --noise 1e300", "noise_sigma = 1e+300; expected a number from 0 to 255"),
        (f"{RENDER} --speed 0", "speed"),
        (f"{RENDER} --seed -1", "--seed -1; expected a number of at least 0"),
        ("reach train --arm left --seed -1 --out TMP/m.npz", "--seed -1; expected a number of at least 0"),
        ("reach train --arm left --max-error 5 --out TMP/m.npz", "--max-error 5.0; expected a share"),
        ("track REC --reduction 121 --out TMP/out", "reduction 121; expected 1 to 120, half an image's side"),
        (
            "evaluate --boxes REC/truth.csv REC/truth.csv --track-id 0",
            "--track-id with --boxes; expected it only",
        ),
        ("evaluate REC/truth.csv REC/truth.csv --first-px 0", "--first-px without --boxes; expected it only with"),
        (f"{RENDER} --radius 30", "--radius 30.0 m; expected above 0 and at most 0.3"),
        (f"{RENDER} --target left_forearm:4711", "left_forearm:4711"),
        ("render --stimulus whale --motion circle --out TMP/out", "marker, ball, cube, octopus, FILE.stl"),
        ("bench tracking --n 0 --out TMP/results", "expected at least"),
        ("bench loop --n 0 --out TMP/results", "expected at least"),
        ("demo --trials 0 --out TMP/demo", "expected at least"),
        ("demo --encounters 0 --out TMP/demo", "--encounters 0; expected at least 1"),
        ("demo --robot x.toml --out TMP/demo", "x.toml: cannot be read"),
    ],
)
def test_a_command_line_that_asks_for_the_impossible(refused, approach, tmp_path, words, message):
    line = refused(*words.replace("TMP", str(tmp_path)).replace("REC", str(approach)).split())
    assert message in line
    assert not any(file.is_file() for file in tmp_path.rglob("*"))


def test_a_place_that_is_none(refused, approach, tmp_path):
    """An empty word, a whole disk, a link that leads nowhere."""
    out = tmp_path / "out"
    assert "a word is empty" in refused("track", "", "--out", out)
    for k in range(1001):
        (tmp_path / "disk" / str(k)).mkdir(parents=True)
    assert "disk: holds more than 1000 folders" in refused("track", tmp_path / "disk", "--out", out)
    for name in ("truth.csv", "icubEyes.ini"):
        rec = shutil.copytree(approach, tmp_path / name)
        (rec / name).unlink()
        (rec / name).symlink_to("gone")
        assert f"{name}: cannot be read" in refused("track", rec, "--out", out)


def test_functions_that_are_not_compiled():
    command = [sys.executable, "-c", "import pps_vision.jit"]
    done = subprocess.run(command, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True)
    assert "InputError: NUMBA_DISABLE_JIT: is set; expected it unset" in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("show TMP/other.npz --out TMP/f.png", "other.npz"),
        ("show TMP/m.npz --out TMP/figure.xyz", "figure.xyz: has the suffix '.xyz'; expected one of ."),
        ("show TMP/m.npz --out TMP/figure", "figure: has the suffix ''; expected one of ."),
        ("render --stimulus TMP/half.ply --motion circle --out TMP/out", "half.ply: "),
        ("render --stimulus ball --motion circle --out TMP", "half.ply"),
    ],
)
def test_files_of_another_kind(refused, tmp_path, words, message):
    """The last would overwrite a folder that is not empty."""
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    save_memory(tmp_path / "m.npz", PPSMemory.empty(icub_skin(("left_palm",))))
    (tmp_path / "half.ply").write_text("ply\n")
    assert message in refused(*words.replace("TMP", str(tmp_path)).split())
    assert {file.name for file in tmp_path.iterdir()} == {"half.ply", "m.npz", "other.npz"}


def test_a_recording_without_a_calibration(refused, approach, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(approach, bare, ignore=shutil.ignore_patterns("icubEyes.ini"))
    assert "icubEyes.ini" in refused("track", bare, "--out", tmp_path / "out")
    assert "holds no calibration" in refused("truth", bare, "--aruco", 7, "--tag-mm", 48, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_is_learned_from_unreadable_recordings(refused_with, tmp_path):
    lines = refused_with("learn", tmp_path / "gone", tmp_path / "lost", "--out", tmp_path / "m.npz")
    assert "gone" in lines[0]
    assert "lost" in lines[1]
    assert "none of 2 recordings" in lines[2]
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_output(refused, approach, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "file" in refused("track", approach, "--out", tmp_path / "file")
    assert "file" in refused("render", "--stimulus", "ball", "--motion", "circle", "--out", tmp_path / "file")
    assert "file: is no folder; expected" in refused("batch", approach, "--out", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


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
def test_no_command_writes_over_what_it_reads(refused, tmp_path, words):
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


def test_a_first_box_in_an_image_that_cannot_be_read(refused, approach, tmp_path):
    shutil.copytree(approach / "cam" / "left", tmp_path / "frames")
    first = min((tmp_path / "frames").glob("*.p*m"))
    first.write_bytes(b"")
    line = refused("track2d", tmp_path / "frames", "--init", 100, 100, 20, 20, "--out", tmp_path / "boxes.csv")
    assert first.name in line
    assert "--init is the box in that image" in line


def test_python_control_beside_us_is_refused(refused, monkeypatch, tmp_path):
    (tmp_path / "control-0.10.2.dist-info").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "python-control" in refused("track2d", tmp_path, "--init", 1, 1, 9, 9, "--out", tmp_path / "b.csv")


def test_what_needs_a_robot_or_one_of_its_parts(refused, tmp_path, calib):
    """Videos have none; the arm of seven joints is a right one, and its cameras are not the iCub's."""
    write_video(tmp_path / "a.mp4", [0.0, 0.05])
    arm7, out = ("--robot", ARM7), ("--out", tmp_path / "out")
    video = tmp_path / "a.mp4", "--calib", calib, *out
    assert "without a robot; expected it with an iCub's REC" in refused("track", *video, "--memory", tmp_path / "m.npz")
    recording = open_recording(tmp_path / "a.mp4", calib=[calib])
    with pytest.raises(InputError, match="has no joints; expected the recording of a robot"):
        learn_from(recording, PPSMemory.empty(icub_skin()), "generic", 0, icub_setup())
    assert "has no left_arm; expected --arm right" in refused("reach", "train", *arm7, "--arm", "left", *out)
    assert "--motion circle without --center" in refused(
        "render", *arm7, "--stimulus", "ball", "--motion", "circle", "--target", "forearm:4", *out
    )
    save_memory(tmp_path / "m.npz", PPSMemory.empty(icub_skin()))
    assert "m.npz" in refused("show", tmp_path / "m.npz", *arm7, "--out", tmp_path / "m.png")
    assert not (tmp_path / "out").exists()
