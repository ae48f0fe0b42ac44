"""Batches of tiny videos: what is finished stays, what fails fails alone, and the number of workers does not matter."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from videos import write_video

from pps_vision.app.cli import main


def table(out: Path) -> dict[str, dict[str, str]]:
    with (out / "batch.csv").open() as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def results(out: Path) -> dict[str, bytes]:
    return {str(f.relative_to(out)): f.read_bytes() for f in out.rglob("*.csv") if f.name != "batch.csv"}


def test_a_batch(tmp_path: Path, calib: Path, refused, capsys: pytest.CaptureFixture[str]) -> None:
    for name, n in (("a.mp4", 6), ("c.mp4", 8)):
        write_video(tmp_path / name, [k / 20 for k in range(n)])
    (tmp_path / "b.mp4").write_bytes(b"no video")
    args = ["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--out"]
    one, two = tmp_path / "one", tmp_path / "two"
    main([*args, str(one)])
    assert "failed: b.mp4: " in (said := capsys.readouterr().out)
    assert "2 of 3 recordings tracked" in said
    rows = table(one)
    assert [rows[name]["status"] for name in ("a.mp4", "b.mp4", "c.mp4")] == ["done", "failed", "done"]
    assert "b.mp4: cannot be read" in rows["b.mp4"]["reason"]
    assert (rows["a.mp4"]["pairs"], rows["c.mp4"]["pairs"]) == ("6", "8")
    assert not (one / "b.mp4").exists()
    # again: what is finished is kept, what failed is tried again
    before = (one / "a.mp4" / "summary.json").stat().st_mtime_ns
    write_video(tmp_path / "b.mp4", [k / 20 for k in range(4)])
    main([*args, str(one)])
    assert {row["status"] for row in table(one).values()} == {"done"}
    assert (one / "a.mp4" / "summary.json").stat().st_mtime_ns == before
    main([*args, str(two), "--workers", "2"])
    assert results(two) == results(one)
    assert "expected the options" in refused(*args, one, "--seed", 3)


def test_a_manifest(tmp_path: Path, calib: Path, refused) -> None:
    for name in ("l", "r"):
        write_video(tmp_path / f"{name}.mp4", [k / 20 for k in range(5)])
    (tmp_path / "list.csv").write_text("name,left,right,calib,fps\nfirst,l.mp4,r.mp4,calib.yml,10\n")
    main(["batch", str(tmp_path / "list.csv"), "--out", str(tmp_path / "out")])
    with (tmp_path / "out" / "first" / "trajectory.csv").open() as file:
        assert [float(row["stamp_s"]) for row in csv.DictReader(file)] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    for rows in ("rec\na\n", "name,rec\n../a,x\n", "name,colour\na,red\n", "name,rec\na,x,y\n"):
        (tmp_path / "list.csv").write_text(rows)
        assert "expected columns name" in refused("batch", tmp_path / "list.csv", "--out", tmp_path / "other")
    (tmp_path / "list.csv").write_text("name,rec\na,x\na,y\n")
    assert "distinct names" in refused("batch", tmp_path / "list.csv", "--out", tmp_path / "other")
    assert "matches no recording" in refused("batch", tmp_path / "gone*", "--out", tmp_path / "other")


def test_killed_and_continued(tmp_path: Path, calib: Path) -> None:
    """After kill -9 in the middle no half result has a final name; a second batch is refused while work goes on."""
    for k in range(2):
        write_video(tmp_path / f"{k}.mp4", [i / 20 for i in range(5)])
    out = tmp_path / "out"
    words = ["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--out", str(out)]
    command = [sys.executable, "-m", "pps_vision", *words]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True) as running:
        deadline = time.monotonic() + 120
        while not (out / "0.mp4").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        second = subprocess.run(command, capture_output=True, text=True)
        os.killpg(running.pid, signal.SIGKILL)
    with suppress(ProcessLookupError):  # what it had started holds the lock until it has died too
        while time.monotonic() < deadline:
            os.killpg(running.pid, 0)
            time.sleep(0.02)
    assert (second.returncode, "another run is writing to it" in second.stderr) == (2, True)
    finished = list(out.glob("[0-9].mp4"))
    assert len(finished) == 1
    assert all(json.loads((folder / "summary.json").read_text())["frames"] == 5 for folder in finished)
    main(words)
    assert [row["status"] for row in table(out).values()] == ["done"] * 2
    assert sorted(path.name for path in out.iterdir()) == ["0.mp4", "1.mp4", "batch.csv", "settings.json"]
