"""Batches of tiny videos: finished results are kept, failures are independent, more workers change nothing."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas
import pytest
from videos import write_video

from learning.pps.memory import load_memory
from pps_vision.app.cli import main
from pps_vision.recordings.tables import read_table

FILES = {"batch.csv", "settings.json", "summary.json"}


def table(out: Path) -> dict[str, dict[str, str]]:
    with (out / "batch.csv").open() as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def results(out: Path) -> dict[str, bytes]:
    return {str(f.relative_to(out)): f.read_bytes() for f in out.rglob("*.csv") if f.name != "batch.csv"}


def is_there(group: int) -> bool:
    """Whether a process of a group is running."""
    with suppress(ProcessLookupError):
        os.killpg(group, 0)
        return True
    return False


def test_a_batch(tmp_path, calib, fails_in_part, capsys):
    for name, n in (("a.mp4", 6), ("c.mp4", 8)):
        write_video(tmp_path / name, [k / 20 for k in range(n)])
    (tmp_path / "b.mp4").write_bytes(b"no video")
    args = ["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--out"]
    out = tmp_path / "out"
    fails_in_part(*args[1:], out, "--workers", "2")
    assert "failed: b.mp4: " in (printed := capsys.readouterr().out)
    assert "2 of 3 recordings tracked" in printed
    rows = table(out)
    assert [rows[name]["status"] for name in ("a.mp4", "b.mp4", "c.mp4")] == ["done", "failed", "done"]
    assert "b.mp4: cannot be read" in rows["b.mp4"]["reason"]
    assert (rows["a.mp4"]["pairs"], rows["c.mp4"]["pairs"]) == ("6", "8")
    assert not (out / "b.mp4").exists()
    # again: finished results stay, failed recordings are tried again
    first_ns = (out / "a.mp4" / "summary.json").stat().st_mtime_ns
    write_video(tmp_path / "b.mp4", [k / 20 for k in range(4)])
    main([*args, str(out)])
    assert {row["status"] for row in table(out).values()} == {"done"}
    assert (out / "a.mp4" / "summary.json").stat().st_mtime_ns == first_ns
    main(["track", str(tmp_path / "c.mp4"), *args[2:], str(tmp_path / "c")])
    assert results(tmp_path / "c") == results(out / "c.mp4") != {}


def test_a_folder_begun_with_other_options_or_with_settings_that_are_none(tmp_path, refused_with):
    (tmp_path / "a.mp4").touch()
    words = ["batch", tmp_path / "a.mp4", "--out", tmp_path / "out"]
    refused_with(*words, "--order=3")
    for options, begun in ((["--order=2"], "with --order 3"), (["--order=3", "--smooth"], "without --smooth")):
        line = refused_with(*words, *options)[-1]
        assert f"out: was begun {begun}; expected the same options, or another folder" in line
    for content in ("{", "1"):
        (tmp_path / "out" / "settings.json").write_text(content)
        assert re.search("settings.json: .*; expected the settings of a batch", refused_with(*words)[-1])


def test_a_result_of_another_recording_or_row_is_not_taken_for_its_own(tmp_path, calib, refused):
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(4)])
    words = ["batch", str(tmp_path / "list.csv"), "--calib", str(calib), "--out", str(tmp_path / "out")]
    for row, other in ((",a.mp4", ""), (",b.mp4", r"/b\.mp4"), ("9,a.mp4", r"/a\.mp4 --fps 9")):
        (tmp_path / "list.csv").write_text(f"name,fps,rec\nrun,{row}\n")
        said = rf"list\.csv:2: \S*/run is of \S*/a\.mp4, not of \S*{other}; expected another name"
        assert re.search(said, refused(*words)) if other else main(words) is None
    (tmp_path / "out" / "settings.json").unlink()
    assert "out: already holds summary.json; expected a new folder, or one of a batch" in refused(*words)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", ":1: no column name; expected the columns name and some of rec, left"),
        ("name,colour\na,red\n", ":1: column 'colour'; expected the columns name and some of rec, left"),
        ("name;rec\na;b\n", ":1: column 'name;rec'; expected .* separated by commas"),
        ("name,rec,rec\na,b,c\n", ":1: column 'rec'; expected .* each once"),
        ("name,rec\n../a,x\n", ":2: name '../a'; expected the name of a new folder"),
        ("name,rec\n\0a,x\n", r":2: name '\\x00a'; expected the name of a new folder"),
        ("name,rec\na,x\n\n,y\n", ":4: name ''; expected the name of a new folder"),
        ("name,rec\na,x\na,y\n", ":3: name 'a' is that of .*list.csv:2 too; expected distinct names"),
        ("name,rec\nsettings.json,x\n", ":2: a result called settings.json; expected none of"),
        ("name,rec,fps\na,x\n", ":2: 2 fields under 3 columns; expected a field for each column"),
        (f"name,rec\na,{'x' * 200_000}\n", ":2: cannot be read: "),  # longer than a field may be
        ("name,rec,fps\na,x,0\n", ":2: fps '0'; expected a positive number"),
        ("name,rec,unit_m\na,x,1;2\n", ":2: unit_m '1;2'; expected a positive number"),
        ("name,rec,max_skew_s\na,x,-0.1\n", ":2: max_skew_s '-0.1'; expected a number of at least 0"),
    ],
)
def test_a_manifest_is_refused_before_anything_starts(content, said, tmp_path, refused):
    (tmp_path / "list.csv").write_text(content)
    line = refused("batch", tmp_path / "list.csv", "--out", tmp_path / "out")
    assert re.match(re.escape(f"pps-vision: {tmp_path / 'list.csv'}") + said, line), line
    assert not (tmp_path / "out").exists()


def test_where_nothing_is_to_do_or_nothing_can_be_written(tmp_path, calib, refused):
    (tmp_path / "list.csv").write_text("name,rec\n")
    assert "no recording given" in refused("batch", tmp_path / "list.csv", "--out", tmp_path / "out")
    assert "matches no recording" in refused("batch", tmp_path / "gone*", "--out", tmp_path / "out")
    write_video(tmp_path / "a.mp4", [0.0, 0.05])
    for out in (tmp_path / "a.mp4" / "out", "/proc/out"):
        line = refused("batch", tmp_path / "a.mp4", "--calib", calib, "--out", out)
        assert "expected a writable place" in line


def test_a_row_s_own_options_go_before_those_for_all(tmp_path, calib, monkeypatch):
    """Files beside the manifest do not run."""
    for name in ("a", "r"):
        write_video(tmp_path / f"{name}.mp4", [k / 20 for k in range(4)])
    (tmp_path / "other.yml").write_bytes(calib.read_bytes())
    rows = ("name,rec,left,right,calib,fps,unit_m", "a,a.mp4,,,other.yml,10,0.01", "b,,a.mp4,r.mp4,,,")
    (tmp_path / "list.csv").write_text("".join(f"{row}\n" for row in rows))
    for name in ("numpy", "tracking"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a file of the working folder was imported')")
    monkeypatch.chdir(tmp_path)
    main(["batch", "list.csv", "--calib", calib.name, "--fps", "5", "--unit-m", "2", "--out", "out"])
    a, b = (json.loads((tmp_path / "out" / name / "summary.json").read_text())["command"] for name in "ab")
    assert re.search(r"track /\S*/a.mp4 --calib /\S*/other.yml --unit-m 0.01 --fps 10.0", a)
    assert re.search(r"track --left /\S*/a.mp4 --right /\S*/r.mp4 --calib /\S*/calib.yml --unit-m 2.0 --fps 5.0", b)
    with (tmp_path / "out" / "b" / "trajectory.csv").open() as file:
        assert [float(row["stamp_s"]) for row in csv.DictReader(file)] == pytest.approx([0, 0.2, 0.4, 0.6])


def test_why_a_row_failed_begins_with_its_place(tmp_path, calib, refused_with):
    file = tmp_path / "list.csv"
    file.write_text("name,left,right,calib\na,gone.mp4,r.mp4,calib.yml\n\nb,-l.mp4,r.mp4,calib.yml\n")
    refused_with("batch", file, "--out", tmp_path / "out")
    reasons = [row["reason"] for row in table(tmp_path / "out").values()]
    assert re.match(re.escape(f"{file}:2: {tmp_path}/gone.mp4: ") + ".*expected ", reasons[0])
    assert reasons[1].startswith(f"{file}:4: {tmp_path}/-l.mp4: ")


def test_every_recording_ends_as_a_row(tmp_path, calib, fails_in_part):
    """Odd names, an unreadable summary of an earlier run: the others go on, names are read back unchanged."""
    names = ["--help", "=1+1\n\udcff ", "c.mp4"]
    for name in names:
        write_video(tmp_path / "c.mp4", [0.0, 0.05])
        (tmp_path / "in" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "c.mp4").rename(tmp_path / "in" / name)
    out = tmp_path / "out"
    (out / "c.mp4").mkdir(parents=True)
    (out / "c.mp4" / "summary.json").write_text("{}")
    words = [tmp_path / "in" / "*", "--calib", calib, "--parquet", "--report", "--out", out]
    fails_in_part(*words, "--workers", "2")
    rows = {name: row for _, (name, *row) in read_table(out / "batch.csv", ["name", "status", "reason"], exact=True)}
    assert set(rows) == set(names)
    assert "summary.json: " in rows["c.mp4"][1]
    assert (out / "batch.csv").read_bytes().count(b"'=1+1") == 1
    (out / "report.html").unlink()
    fails_in_part(*words, "--collect")
    assert (out / "report.html").is_file()


def test_a_recording_without_progress_is_ended(tmp_path, calib, refused_with, refused):
    write_video(tmp_path / "a.mp4", [0.0, 0.05])
    words = ["batch", tmp_path / "a.mp4", "--calib", calib, "--out", tmp_path / "out", "--stalled-s"]
    refused_with(*words, "0.01")  # before the first pair is read
    assert table(tmp_path / "out")["a.mp4"]["reason"] == "no progress for 0.01 s"
    assert "--stalled-s 0; expected a positive number" in refused(*words, "0")


def test_killed_and_continued(tmp_path, calib):
    """After kill -9 in the middle no half result has a final name and nothing goes on, so that the next batch can begin
    at once; a second batch is refused while work goes on."""
    for k in range(2):
        write_video(tmp_path / f"{k}.mp4", [i / 20 for i in range(5)])
    out = tmp_path / "out"
    words = ["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--out", str(out)]
    command = [sys.executable, "-m", "pps_vision", *words]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True) as running:
        deadline = time.monotonic() + 120
        while not list(out.glob(".1.mp4.*.partial")) and time.monotonic() < deadline:
            time.sleep(0.01)
        os.killpg(running.pid, signal.SIGSTOP)
        second = subprocess.run(command, capture_output=True, text=True)
        running.kill()
        os.killpg(running.pid, signal.SIGCONT)
    assert (second.returncode, "another run is writing to it" in second.stderr) == (2, True)
    while is_there(running.pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_there(running.pid)  # nor are its children
    finished = list(out.glob("[0-9].mp4"))
    assert len(finished) == 1
    assert json.loads((finished[0] / "summary.json").read_text())["frames"] == 5
    main(words)
    assert [row["status"] for row in table(out).values()] == ["done"] * 2
    assert {path.name for path in out.iterdir()} == {"0.mp4", "1.mp4", *FILES}


def test_learning_from_many_is_learning_from_each(approach, tmp_path, refused, fails_in_part, capsys):
    """Bit for bit the memory that one `learn` in the order of the recordings gives, with two workers."""
    for name in ("a", "b"):
        shutil.copytree(approach, tmp_path / name)
    for log in tmp_path.glob("[ab]/cam/*/data.log"):
        log.write_text("".join(log.read_text().splitlines(keepends=True)[16:42]))
    (tmp_path / "c").mkdir()
    out, words = tmp_path / "out", [str(tmp_path / "[abc]"), "--learn", "--workers", "2"]
    fails_in_part(*words, "--parquet", "--out", out)
    assert "2 of 3 recordings learned" in capsys.readouterr().out
    main(["learn", str(tmp_path / "a"), "--into", str(out / "b.npz"), "--out", str(tmp_path / "both.npz")])
    together = load_memory(tmp_path / "both.npz")
    single = load_memory(out / "b.npz")
    assert single.counts.sum() > 0
    np.testing.assert_array_equal(load_memory(out / "memory.npz").counts, together.counts)
    touched = single.samples[:, 0] > 0
    rows = table(out)
    assert [int(rows[name]["samples"]) for name in "ab"] == [single.counts.sum()] * 2
    assert int(rows["a"]["touched_taxels"]) == touched.sum()
    assert [rows[name]["version"] for name in "abc"] == [version("pps-vision")] * 2 + [""]
    assert "a yarpdatadumper recording" in rows["c"]["reason"]
    read = pandas.read_parquet(out / "batch.parquet")
    assert read["name"].tolist() == ["a", "b", "c"]
    assert read["samples"].tolist()[:2] == [single.counts.sum()] * 2
    assert read["samples"].isna().tolist() == [False, False, True]
    assert "was begun with --learn; expected the same options" in refused("batch", *words[:1], "--out", out)
    assert "--learn with --smooth" in refused("batch", *words, "--smooth", "--out", tmp_path / "other")


def test_parquet_without_the_extra(tmp_path, calib, refused, monkeypatch):
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(6)])
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    words = ["batch", tmp_path / "a.mp4", "--calib", calib, "--parquet", "--out", tmp_path / "out"]
    assert "pps-vision[parquet]" in refused(*words)


@pytest.mark.long
def test_a_full_disk_and_a_place_that_is_taken_fail_alone(tmp_path, calib):
    """A long recording's tables exceed the largest file that may be written; a file stands where a folder should."""
    for name, n in (("a.mp4", 4), ("b.mp4", 200), ("c.mp4", 4)):
        write_video(tmp_path / name, [k / 20 for k in range(n)])
    words = ["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--out"]
    main(["batch", str(tmp_path / "b.mp4"), *words[2:], str(tmp_path / "whole")])  # also compiles, which writes files
    out = tmp_path / "out"
    out.mkdir()
    (out / "c.mp4").write_bytes(b"mine")
    limit = 6000
    assert (tmp_path / "whole" / "b.mp4" / "trajectory.csv").stat().st_size > limit
    command = ["prlimit", f"--fsize={limit}", sys.executable, "-m", "pps_vision", *words, str(out)]
    full = subprocess.run(command, capture_output=True, text=True)
    assert (full.returncode, full.stderr.count("Traceback")) == (1, 0), full.stderr
    rows = table(out)
    assert [row["status"] for row in rows.values()] == ["done", "failed", "failed"]
    assert re.fullmatch(r".*b\.mp4: cannot be written: .*; expected free space", rows["b.mp4"]["reason"])
    assert "is no folder" in rows["c.mp4"]["reason"]
    assert (out / "c.mp4").read_bytes() == b"mine"
    assert {path.name for path in out.iterdir()} == {"a.mp4", "c.mp4", *FILES}


TIMES = ("ms_per_pair",)  # columns that no two runs share


def rows_without_times(out: Path) -> list[list[str]]:
    with (out / "batch.csv").open() as file:
        return [[value for key, value in row.items() if key not in TIMES] for row in csv.DictReader(file)]


def test_shards_that_are_collected_equal_one_process(tmp_path, calib, fails_in_part, refused, refused_with):
    for name in "ac":
        write_video(tmp_path / f"{name}.mp4", [k / 20 for k in range(4)])
    (tmp_path / "b.mp4").write_bytes(b"no video")
    words = [tmp_path / "*.mp4", "--calib", calib, "--out"]
    out = tmp_path / "out"
    fails_in_part(*words, tmp_path / "alone")
    main(["batch", *map(str, words), str(out), "--shard", "1/2"])  # a, c
    fails_in_part(*words, out, "--collect")
    assert [row[1] for row in rows_without_times(out)] == ["done", "failed", "done"]
    assert {row["reason"] for row in table(out).values()} >= {"has no result: it was not tracked, or ended before"}
    refused_with("batch", *words, out, "--shard", "2/2")  # b
    fails_in_part(*words, out, "--collect")
    assert rows_without_times(out) == rows_without_times(tmp_path / "alone")
    assert results(out) == results(tmp_path / "alone")
    for shard in ("0/2", "3/2", "1", "1/2/3"):
        assert f"--shard {shard}; expected I/N with I from 1 to N" in refused("batch", *words, out, "--shard", shard)
    assert "--shard with --collect" in refused("batch", *words, out, "--shard", "1/2", "--collect")


@pytest.mark.long
def test_shards_of_which_two_are_killed_and_run_again(tmp_path, calib):
    """200 recordings, of which two fail, in the shards of the SLURM script, four at a time; by its own exit codes."""
    (tmp_path / "bin").mkdir()
    video = write_video(tmp_path / "bin" / "video.mp4", [k / 20 for k in range(4)])
    for k in range(200):
        shutil.copy(video, tmp_path / f"{k:03}.mp4")
    for k in (17, 108):
        (tmp_path / f"{k:03}.mp4").write_bytes(b"no video")
    program = tmp_path / "bin" / "pps-vision"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m pps_vision "$@"\n')
    program.chmod(0o755)
    words = ["*.mp4", "--calib", str(calib), "--out"]
    script = Path(__file__).parents[2] / "docs" / "cluster" / "array.sh"

    def shard(number: int) -> subprocess.Popen[bytes]:
        path = f"{tmp_path / 'bin'}:{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "SLURM_ARRAY_TASK_ID": str(number)}
        return subprocess.Popen([script, *words, "out"], cwd=tmp_path, env=environment)

    def n_results() -> int:
        return len(list((tmp_path / "out").glob("*.mp4/summary.json")))

    codes = []
    for numbers in ((1, 2, 3, 4), (5, 6, 7, 8)):
        running = [shard(number) for number in numbers]
        n = n_results()
        while n_results() < n + 25 and running[1].poll() is None:
            time.sleep(0.1)
        running[1].kill()  # shards 2 and 6
        codes += [process.wait() for process in running]
    codes += [shard(number).wait() for number in (2, 6)]
    failing = {17 % 8 + 1: 1, 108 % 8 + 1: 1}  # exit code 1: some failed
    expected = {number: failing.get(number, 0) for number in range(1, 9)} | {2: -signal.SIGKILL, 6: -signal.SIGKILL}
    assert codes == [*expected.values(), failing.get(2, 0), failing.get(6, 0)]
    for options in (["out", "--collect"], ["alone"]):
        assert subprocess.run([program, "batch", *words, *options], cwd=tmp_path).returncode == 1
    assert len(rows_without_times(tmp_path / "alone")) == 200
    assert rows_without_times(tmp_path / "out") == rows_without_times(tmp_path / "alone")


@pytest.mark.skipif(not shutil.which("snakemake"), reason="no snakemake (extra snakemake)")
def test_the_snakefile_runs_shards_and_collects_them(tmp_path, calib, fails_in_part):
    for name in "ac":
        write_video(tmp_path / f"{name}.mp4", [k / 20 for k in range(4)])
    (tmp_path / "b.mp4").write_bytes(b"no video")
    (tmp_path / "pps-vision").write_text(f'#!/bin/sh\nexec {sys.executable} -m pps_vision "$@"\n')
    (tmp_path / "pps-vision").chmod(0o755)
    snakefile = Path(__file__).parents[2] / "docs" / "cluster" / "Snakefile"
    config = ["recs=*.mp4", f"calib={calib}", "out=out", "shards=2"]
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = ["snakemake", "-s", snakefile, "--cores", "2", "--config", *config]
    subprocess.run(command, cwd=tmp_path, env=environment, check=True)
    fails_in_part(tmp_path / "*.mp4", "--calib", calib, "--out", tmp_path / "alone")
    assert rows_without_times(tmp_path / "out") == rows_without_times(tmp_path / "alone")
