"""The unchanged SLURM script, with `srun` starting two Dask workers here, of which one is killed in the middle."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from videos import write_video

from pps_vision.app.batch import Cluster
from pps_vision.app.cli import main

SCRIPT = Path(__file__).parents[2] / "docs" / "cluster" / "slurm.sh"
N = 3
PROGRAMS = {
    "srun": '#!/bin/sh\nfor k in 1 2; do "$@" & echo $! >> workers; done\nwait\n',
    "dask": f'#!/bin/sh\nname=$1; shift\nexec {sys.executable} -m distributed.cli.dask_$name "$@"\n',
    "pps-vision": f'#!/bin/sh\nexec {sys.executable} -m pps_vision "$@"\n',
}


@pytest.mark.long
def test_one_of_two_workers_dies(tmp_path, calib):
    for k in range(N):
        write_video(tmp_path / f"{k}.mp4", [i / 20 for i in range(4)])
    (tmp_path / "2.mp4").write_bytes(b"no video")
    for name, content in PROGRAMS.items():
        (tmp_path / "bin" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "bin" / name).write_text(content)
        (tmp_path / "bin" / name).chmod(0o755)
    words = ["*.mp4", "--calib", str(calib), "--out"]
    environment = {**os.environ, "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
    with subprocess.Popen(
        [SCRIPT, *words, "cluster"],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        deadline = time.monotonic() + 600
        while (
            not list((tmp_path / "cluster").glob(".*.partial"))
            and running.poll() is None
            and time.monotonic() < deadline
        ):
            time.sleep(0.02)
        os.kill(int((tmp_path / "workers").read_text().split()[0]), signal.SIGKILL)
        said, errors = running.communicate(timeout=600)
    assert running.returncode == 1, errors  # one recording failed
    assert "2 of 3 recordings tracked" in said
    with (tmp_path / "cluster" / "batch.csv").open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert [rows[f"{k}.mp4"]["status"] for k in range(N)] == ["done"] * 2 + ["failed"]
    assert "2.mp4: cannot be read" in rows["2.mp4"]["reason"]
    main(["track", str(tmp_path / "0.mp4"), "--calib", str(calib), "--out", str(tmp_path / "alone")])
    for name in ("trajectory.csv", "detections.csv"):  # bit for bit
        assert (tmp_path / "cluster" / "0.mp4" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert "tls://" in errors
    assert "tcp://" not in errors
    left = {path.name for path in (tmp_path / "cluster").iterdir()}
    assert left == {"0.mp4", "1.mp4", "batch.csv", "settings.json", "summary.json"}
    assert not list(tmp_path.glob(".dask-*"))


def test_a_cluster_that_is_not_there(tmp_path, calib, refused, monkeypatch):
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "1s")
    write_video(tmp_path / "a.mp4", [0.0, 0.1])
    words = ("batch", tmp_path / "a.mp4", "--calib", calib, "--out", tmp_path / "out")
    assert "127.0.0.1:9" in refused(*words, "--scheduler", "tcp://127.0.0.1:9")


@pytest.mark.parametrize(
    ("address", "tls", "warns"),
    [
        *[("tcp://10.0.0.9:8786", None, True), ("node7:8786", None, True), ("file.json", None, True)],
        *[("tls://10.0.0.9:8786", None, False), ("tcp://127.0.0.1:8786", None, False), ("file.json", "keys", False)],
    ],
)
def test_who_could_run_code_is_said(address, tls, warns, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.json").write_text('{"address": "tcp://node7:1234"}')
    assert ("can run any code" in Cluster(address, tls and tmp_path / tls).warning) == warns
