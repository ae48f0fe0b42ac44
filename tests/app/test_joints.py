"""A recording whose eyes are read wrongly: what `joints` learns from its touch, and what `track` makes of that."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pps_vision.app.cli import main
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.tables import read_joint_offsets
from pps_vision.robot.icub import load_icub

JOINTS = load_icub().joint_names
PANS = [JOINTS.index("left_eye_pan"), JOINTS.index("right_eye_pan")]


@pytest.fixture(scope="module")
def misread(approach: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The eyes' encoders say that they converge 3° less than they do."""
    rec = tmp_path_factory.mktemp("misread") / "rec"
    shutil.copytree(approach, rec)
    misread_vergence(rec)
    return rec


def misread_vergence(rec: Path) -> None:
    log = next(rec.rglob("head/data.log"))
    rows = [row.split() for row in log.read_text().splitlines()]
    log.write_text("".join(f"{' '.join(row[:-1])} {float(row[-1]) - 3.0}\n" for row in rows))


def position_rms_mm(rec: Path, out: Path, *more: str) -> float:
    main(["track", str(rec), "--out", str(out), *more])
    return float(json.loads((out / "summary.json").read_text())["errors"]["position_rms_mm"])


def test_a_touch_tells_what_the_eyes_misread(misread, tmp_path, capsys):
    table = tmp_path / "joints.csv"
    main(["joints", str(misread), str(tmp_path / "gone"), "--out", str(table)])
    captured = capsys.readouterr()
    assert captured.out.startswith("1 touches, seen ")
    assert "gone" in captured.err
    offsets = np.rad2deg(read_joint_offsets(table, JOINTS))
    assert 1.0 < offsets[PANS[0]] - offsets[PANS[1]] < 4.0  # a part is attributed to the arm: one touch is one posture
    without = position_rms_mm(misread, tmp_path / "without")
    corrected = position_rms_mm(misread, tmp_path / "with", "--joints", str(table))
    assert without > 30
    assert corrected < 0.5 * without
    assert json.loads((tmp_path / "with" / "summary.json").read_text())["joints"] == str(table)


def test_learning_takes_offsets_too(misread, approach, tmp_path):
    """With the true offset the misread recording teaches the same as the right one."""
    table = tmp_path / "true.csv"
    table.write_text("joint,offset_deg\nleft_eye_pan,1.5\nright_eye_pan,-1.5\n")
    main(["learn", str(approach), "--out", str(tmp_path / "right.npz")])
    main(["learn", str(misread), "--joints", str(table), "--out", str(tmp_path / "mended.npz")])
    main(["learn", str(misread), "--out", str(tmp_path / "misread.npz")])
    right, mended, wrong = (np.load(tmp_path / f"{name}.npz")["counts"] for name in ("right", "mended", "misread"))
    assert np.abs(mended - right).sum() <= 0.02 * right.sum()
    assert np.abs(wrong - right).sum() > 0.2 * right.sum()


@pytest.mark.long
def test_a_dozen_touches_correct_the_eyes_by_themselves(misread, tmp_path, capsys):
    """`learn` estimates and applies the offsets; `track --memory` takes them from the memory."""
    recordings = []
    for k, taxel in enumerate((3, 27, 15, 183, 135, 147) * 2):
        recordings.append(tmp_path / f"rec{k}")
        words = f"--stimulus ball --motion approach --target left_forearm:{taxel} --speed 0.12 --seconds 2.5 --noise 2"
        main(["render", *words.split(), "--seed", str(7300 + k), "--out", str(recordings[-1])])
        misread_vergence(recordings[-1])
    memory = tmp_path / "memory.npz"
    main(["learn", *map(str, recordings), "--out", str(memory)])
    assert "body: 12 touches; encoders corrected by up to " in capsys.readouterr().out
    corrected = position_rms_mm(misread, tmp_path / "with", "--memory", str(memory))
    assert corrected < 0.4 * position_rms_mm(misread, tmp_path / "without")
    pans = json.loads((tmp_path / "with" / "summary.json").read_text())["joint_offsets_deg"]
    assert 1.5 < pans["left_eye_pan"] - pans["right_eye_pan"] < 4.5


def test_no_touch_is_refused_and_nothing_is_written(approach, tmp_path, refused):
    rec = tmp_path / "untouched"
    shutil.copytree(approach, rec)
    shutil.rmtree(next(rec.rglob("skin")))
    out = tmp_path / "joints.csv"
    assert f"no touch by a tracked object in {rec}" in refused("joints", rec, "--out", out)
    assert not out.exists()


def test_offsets_are_for_recordings_of_a_robot(tmp_path, refused):
    images = ("--left", "a*.png", "--right", "b*.png", "--calib", "c.yml")
    line = refused("track", *images, "--joints", "joints.csv", "--out", tmp_path / "out")
    assert "joints.csv without a robot" in line
    with pytest.raises(InputError, match=r"taxels t\.ini without skin; expected it with an iCub's folder REC"):
        open_recording(left="a*.png", right="b*.png", calib="c.yml", taxels="t.ini")
