"""Track many recordings, or learn from them, each in a process of its own: `pps-vision batch`.

A recording is finished when its result is there, since `track` and `learn` write it whole or not at all; so a batch
that was killed is continued by running it again.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from glob import glob
from itertools import takewhile
from pathlib import Path
from typing import Literal

from pps_vision.__main__ import ENDS_WITH_STDIN
from pps_vision.app.progress import progress
from pps_vision.errors import InputError, first_line
from pps_vision.files import read_bytes
from pps_vision.recordings import BATCH, REPORT, SUMMARY
from pps_vision.recordings.atomic_write import BUSY, locked_folder, whole_file
from pps_vision.recordings.parquet import require_pyarrow, write_parquet
from pps_vision.recordings.tables import csv_rows, write_table
from pps_vision.recordings.text import finite

TRACK_TABLE: Mapping[str, type] = {
    **{"name": str, "status": str, "pairs": int, "frames": int, "tracked_share": float},
    **{"position_rms_mm": float, "ms_per_pair": float, "version": str, "reason": str},
}
LEARN_TABLE: Mapping[str, type] = {
    **{"name": str, "status": str, "samples": int, "touched_taxels": int},
    **{"version": str, "reason": str},
}
SETTINGS = "settings.json"
MEMORY = "memory.npz"
_OWN = (SETTINGS, MEMORY, SUMMARY, BATCH, "batch.parquet", REPORT)
_POSITIVE = "a positive number"
_NUMBERS = {"fps": _POSITIVE, "unit_m": _POSITIVE, "max_skew_s": "a number of at least 0"}  # columns of a manifest
_BUSY_S = 0.5  # between two looks at a recording that another run is tracking


@dataclass(frozen=True)
class Job:
    """One recording: the name of its result, and what `pps-vision track` or `learn` is given for it."""

    name: str
    rec: tuple[str, ...]
    options: tuple[str, ...]
    """Its own, which go before those for all."""
    folder: Path
    """Where relative paths begin."""
    row: str = ""
    """FILE:LINE of a manifest that lists it."""

    @property
    def source(self) -> str:
        """What has asked for it: a row of a manifest, or its path."""
        return self.row or self.rec[0]


@dataclass(frozen=True)
class Task:
    """What is done with every recording: the command, its options for all, and the folder of the results."""

    command: Literal["track", "learn"]
    options: tuple[str, ...]
    out: Path

    @property
    def table(self) -> Mapping[str, type]:
        """Columns of the table of results."""
        return TRACK_TABLE if self.command == "track" else LEARN_TABLE

    def result(self, job: Job) -> Path:
        """What the command writes of a recording: a folder, or a memory."""
        return self.out / (job.name if self.command == "track" else f"{job.name}.npz")

    def is_done(self, job: Job) -> bool:
        """Whether a recording is finished."""
        result = self.result(job)
        return (result / SUMMARY).exists() if self.command == "track" else result.exists()

    def row(self, job: Job, reason: str) -> dict[str, object]:
        """The row of a recording; `reason` why it failed, or ""."""
        row: dict[str, object] = dict.fromkeys(self.table) | {"name": job.name}
        if reason:
            return row | {"status": "failed", "reason": f"{job.row}: {reason}" if job.row else reason}
        if self.command == "learn":
            from learning.pps.memory import load_memory

            memory = load_memory(self.result(job))
            samples = memory.counts.sum(axis=(1, 2))
            counted = {"samples": int(samples.sum()), "touched_taxels": int((samples[:, 0] > 0).sum())}
            return row | {"status": "done", "version": memory.written_by} | counted
        summary = json.loads((self.result(job) / SUMMARY).read_text())
        return row | {
            "status": "done",
            "pairs": summary["pairs"],
            "frames": summary["frames"],
            "tracked_share": summary["status"]["tracking"] / summary["frames"],
            "position_rms_mm": summary.get("errors", {}).get("position_rms_mm"),
            "ms_per_pair": summary["ms_per_pair"]["total"]["median_ms"],
            "version": summary["versions"]["pps-vision"],
        }


def jobs_of(sources: Sequence[str], columns: Sequence[str]) -> list[Job]:
    """Jobs of recordings (folders, videos, or patterns), and of manifests: CSV files with `columns`, of which a row has
    those that it needs, and `name`.

    Raises:
        InputError: A pattern matches nothing, a manifest cannot be used, or a name comes twice.
    """
    jobs: list[Job] = []
    for source in sources:
        if Path(source).suffix == ".csv":
            jobs += _manifest(Path(source), columns)
            continue
        matched = sorted(glob(source, recursive=True))
        if not matched:
            raise InputError(source, "matches no recording; expected folders, videos, a pattern, or a manifest .csv")
        jobs += [Job(Path(path).resolve().name, (path,), (), Path.cwd()) for path in matched]
    seen: dict[str, str] = {}
    for job in jobs:
        if job.name in seen:
            expected = "distinct names, which a manifest can give"
            raise InputError(job.source, f"name {job.name!r} is that of {seen[job.name]} too; expected {expected}")
        seen[job.name] = job.source
    return jobs


def _manifest(file: Path, columns: Sequence[str]) -> Iterator[Job]:
    expected = f"the columns name and some of {', '.join(columns)}, separated by commas"
    rows = [(line, row) for line, row in csv_rows(file, expected) if row]
    header = rows[0][1] if rows else []
    if wrong := [key for key in header if key not in ("name", *columns) or header.count(key) > 1]:
        raise InputError(file, f"column {wrong[0]!r}; expected {expected}, each once", 1)
    if "name" not in header:
        raise InputError(file, f"no column name; expected {expected}", 1)
    for line, fields in rows[1:]:
        if len(fields) != len(header):
            found = f"{len(fields)} fields under {len(header)} columns"
            raise InputError(file, f"{found}; expected a field for each column", line)
        row = dict(zip(header, fields, strict=True))
        name, rec = row.pop("name"), row.pop("rec", "")
        if not name or Path(name).name != name or name.startswith("."):
            raise InputError(file, f"name {name!r}; expected the name of a new folder", line)
        given = {key: value for key, value in row.items() if value}
        for key, text in given.items():
            if key in _NUMBERS and not _is_number(text, _NUMBERS[key] == _POSITIVE):
                raise InputError(file, f"{key} {text!r}; expected {_NUMBERS[key]}", line)
        options = [word for key, value in given.items() for word in (_flag(key), *value.split(";"))]
        recs = tuple(rec.split(";")) if rec else ()
        yield Job(name, recs, tuple(options), file.resolve().parent, f"{file}:{line}")


def _is_number(text: str, positive: bool) -> bool:
    """Whether a text spells a finite number that is positive, or at least not negative."""
    try:
        return finite(text) > 0 if positive else finite(text) >= 0
    except ValueError:
        return False


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def run_batch(
    jobs: Sequence[Job], task: Task, workers: int, scheduler: str | None = None, parquet: bool = False
) -> list[dict[str, object]]:
    """Do what is not finished and return a row of the task's table for each job, in their order; they are in batch.csv
    too.

    A recording that cannot be used fails alone.  The results do not depend on where they are made.  What was learned
    from all recordings is added up in memory.npz.

    Args:
        jobs: The recordings.
        task: What is done with them.
        workers: Processes on this machine.
        scheduler: Address or scheduler file of a Dask cluster that does it instead.
        parquet: Also write batch.parquet (extra `parquet`).

    Raises:
        InputError: Another batch is writing to the folder, or has begun there with other options; a name is one of the
            batch's own files; the extra `parquet` is wanted and not there.
        OSError: The cluster does not answer.
    """
    if workers < 1:
        raise InputError("batch", f"{workers} workers; expected at least 1")
    for job in jobs:
        if (name := task.result(job).name) in _OWN:
            raise InputError(job.source, f"a result called {name}; expected none of {', '.join(_OWN)}")
    task, out = replace(task, out=task.out.resolve()), task.out
    with locked_folder(out):
        if parquet:
            require_pyarrow()  # before hours of work
        settings = out / SETTINGS
        if not settings.exists():
            with whole_file(settings) as partial:
                partial.write_text(json.dumps([task.command, *task.options]) + "\n")
        elif difference := _difference(_read_settings(settings), [task.command, *task.options]):
            raise InputError(out, f"was begun {difference}; expected the same options, or another folder")

        with progress(total=len(jobs), desc="batch", unit="recording") as bar:
            if scheduler:
                reasons = _on_cluster(scheduler, jobs, task, bar.update)
            else:
                reasons = []
                with ThreadPoolExecutor(workers) as pool:
                    for reason in pool.map(lambda job: _do(job, task), jobs):
                        reasons.append(reason)
                        bar.update()
        rows = [task.row(job, reason) for job, reason in zip(jobs, reasons, strict=True)]
        if task.command == "learn":
            _add_up([task.result(job) for job, row in zip(jobs, rows, strict=True) if row["status"] == "done"], out)
        with whole_file(out / BATCH) as partial:
            filled = (["" if value is None else value for value in row.values()] for row in rows)
            write_table(partial, tuple(task.table), filled)
        if parquet:
            with whole_file(out / "batch.parquet") as partial:
                write_parquet(partial, task.table, rows)
    return rows


def _read_settings(file: Path) -> list[str]:
    """Command and options that a batch was begun with."""
    try:
        return [str(word) for word in json.loads(read_bytes(file, "the settings of a batch"))]
    except (ValueError, TypeError) as error:
        raise InputError(file, f"{first_line(error)}; expected the settings of a batch, or another folder") from error


def _difference(begun: Sequence[str], asked: Sequence[str]) -> str:
    """How the options of two batches differ: "with --order 4", "without --smooth"; "" if they are the same."""
    if begun[:1] != asked[:1]:
        return f"{'with' if begun[:1] == ['learn'] else 'without'} --learn"
    one, other = (
        re.split(" (?=--)", re.sub(r"(--[\w-]+)=", r"\1 ", shlex.join(words[1:]))) for words in (begun, asked)
    )
    if given := [option for option in one if option not in other]:
        return f"with {' '.join(given)}"
    added = [option for option in other if option not in one]
    return f"without {' '.join(added)}" if added else ""


def _add_up(memories: Sequence[Path], out: Path) -> None:
    """Write the sum of memories; none, no file."""
    from learning.pps.memory import load_memory, save_memory

    total = None
    for file in memories:
        memory = load_memory(file)
        total = memory if total is None else replace(total, counts=total.counts + memory.counts)
    if total is not None:
        with whole_file(out / MEMORY) as partial:
            save_memory(partial, total)


def _on_cluster(scheduler: str, jobs: Sequence[Job], task: Task, advance: Callable[[], object]) -> list[str]:
    """`_do` every job on the workers of a Dask cluster; a job whose worker dies goes to another."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        wanted = "the extra cluster: pip install 'pps-vision[cluster]'"
        raise InputError("batch", f"--scheduler needs Dask; expected {wanted}") from error
    where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
    with Client(**where, set_as_default=False) as client:  # type: ignore[no-untyped-call]
        places = {client.submit(_do, job, task, pure=False): place for place, job in enumerate(jobs)}
        reasons = [""] * len(jobs)
        done = as_completed(list(places), loop=client.loop)  # type: ignore[no-untyped-call]
        for future in done:
            try:
                reasons[places[future]] = future.result()
            except KilledWorker as error:
                reasons[places[future]] = f"the workers that worked on it died: {first_line(error)}"
            advance()
    return reasons


def _do(job: Job, task: Task) -> str:
    """Do one recording unless it is finished; return why it failed, or "".

    What a worker that was killed has started ends with it, but not at once: its end is waited for.
    """
    while (reason := _do_once(job, task)).endswith(BUSY):
        time.sleep(_BUSY_S)
    return reason


def _do_once(job: Job, task: Task) -> str:
    if task.is_done(job):
        return ""
    words = [task.command, *job.rec, *task.options, *job.options, "--out", str(task.result(job))]
    ours_is_open, ours = os.pipe()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pps_vision", *words],
            cwd=job.folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONIOENCODING": "utf-8", ENDS_WITH_STDIN: "1"},
            stdin=ours_is_open,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
        )
    finally:
        os.close(ours_is_open)
        os.close(ours)
    if done.returncode < 0:
        return f"ended by signal {-done.returncode}"
    if done.returncode == 0:
        return ""
    return _reason(done.stderr) or f"ended with exit code {done.returncode}"


def _reason(said: str) -> str:
    """What a command that failed has said last: a line, or the first paragraph in tyro's frame."""
    _, frame, framed = said.partition("╭")
    if frame:
        return " ".join(takewhile(bool, (line.strip(" │─╰╯") for line in framed.splitlines()[1:])))
    lines = [line.strip(" |+-") for line in said.splitlines()]  # which frame a group of tracebacks
    return next(filter(None, reversed(lines)), "").removeprefix("pps-vision: ")
