"""Track many recordings, or learn from them, one process each: `pps-vision batch`.

`track` and `learn` write complete results or none, so a recording with a result is finished; running a killed batch
again continues it.  A shard is every n-th recording, for jobs that know nothing of each other; it notes the reasons of
failures for the process that collects the results.
"""

import json
import os
import re
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from glob import glob
from itertools import takewhile
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryFile
from typing import Literal
from urllib.parse import urlsplit

from pps_vision.app.progress import progress
from pps_vision.app.results import read_result, read_track_summary
from pps_vision.app.starter import Starter
from pps_vision.errors import InputError, first_line
from pps_vision.files import check_regular, read_bytes
from pps_vision.recordings import BATCH, REPORT, SUMMARY
from pps_vision.recordings.atomic_write import BUSY, locked_folder, whole_file
from pps_vision.recordings.tables import csv_rows, require_pyarrow, write_parquet, write_table
from pps_vision.recordings.text import finite

TRACK_TABLE: Mapping[str, type] = {
    **{"name": str, "status": str, "pairs": int, "frames": int, "tracked_share": float},
    **{"position_rms_mm": float, "ms_per_pair": float, "version": str, "reason": str},
}
LEARN_TABLE: Mapping[str, type] = {
    **{"name": str, "status": str, "samples": int, "touched_taxels": int},
    **{"version": str, "reason": str},
}
_TABLES = {"track": TRACK_TABLE, "learn": LEARN_TABLE}
SETTINGS = "settings.json"
MEMORY = "memory.npz"
_OWN = (SETTINGS, MEMORY, SUMMARY, BATCH, "batch.parquet", REPORT)
_POSITIVE = "a positive number"
_PATHS = ("rec", "left", "right", "calib", "times", "joints", "taxels", "robot", "urdf", "skin")  # columns
_NUMBERS = {"fps": _POSITIVE, "unit_m": _POSITIVE, "max_skew_s": "a number of at least 0"}  # columns of a manifest
_BUSY_S = 0.5  # before another try where another run is writing the result


@dataclass(frozen=True)
class Job:
    """One recording: the name of its result, and its arguments of `pps-vision track` or `learn` with absolute paths."""

    name: str
    rec: tuple[str, ...]
    options: tuple[str, ...]  # options of this recording; they override the batch's
    row: str = ""  # FILE:LINE of a manifest that lists it

    @property
    def source(self) -> str:
        """The row of the manifest or the path that lists the recording."""
        return self.row or self.rec[0]


@dataclass(frozen=True)
class Task:
    """The command for every recording, its common options, and the folder of the results.

    A recording that makes no progress for `stalled_s` is ended.
    """

    command: Literal["track", "learn"]
    options: tuple[str, ...]
    out: Path
    stalled_s: float

    def result(self, job: Job) -> Path:
        """The output of the command for a recording: a folder, or a memory."""
        return self.out / (job.name if self.command == "track" else f"{job.name}.npz")

    def is_done(self, job: Job) -> bool:
        """Whether a recording has a result."""
        result = self.result(job)
        return (result / SUMMARY if self.command == "track" else result).exists()

    def failure(self, job: Job) -> Path:
        """The file with the reason why a recording of a shard failed."""
        return self.out / f"{job.name}.failed"

    def kept_reason(self, job: Job) -> str:
        """Why a recording of a shard has no result, or ""."""
        file = self.failure(job)
        if self.is_done(job):
            return ""
        if not file.exists():
            return "has no result: it was not tracked, or ended before"
        return read_bytes(file, "the reason of a failure").decode("utf-8", "surrogateescape").removesuffix("\n")

    def row(self, job: Job, reason: str) -> dict[str, object]:
        """The row of a recording; `reason`: of its failure, or ""."""
        row: dict[str, object] = dict.fromkeys(_TABLES[self.command]) | {"name": job.name}
        try:
            if not reason:
                return row | {"status": "done"} | self._numbers(job)
        except InputError as error:
            reason = str(error)
        return row | {"status": "failed", "reason": f"{job.row}: {reason}" if job.row else reason}

    def _numbers(self, job: Job) -> dict[str, object]:
        if self.command == "learn":
            from learning.pps.memory import load_memory

            memory = load_memory(self.result(job))
            samples = memory.samples
            counted = {"samples": int(samples.sum()), "touched_taxels": int((samples[:, 0] > 0).sum())}
            return {"version": memory.written_by, **counted}
        summary = read_track_summary(self.result(job))
        return {
            "pairs": summary["pairs"],
            "frames": summary["frames"],
            "tracked_share": summary["status"].get("tracking", 0) / summary["frames"],
            "position_rms_mm": summary.get("errors", {}).get("position_rms_mm"),
            "ms_per_pair": summary["ms_per_pair"]["total"]["median_ms"],
            "version": summary.get("versions", {}).get("pps-vision"),
        }


@dataclass(frozen=True)
class Cluster:
    """Address or scheduler file of a Dask cluster, and the folder of its certificate (cert.pem, key.pem), if it has
    one."""

    scheduler: str
    tls: Path | None = None

    @property
    def warning(self) -> str:
        """That nothing is encrypted on the way to another machine, or ""."""
        address = self.scheduler
        with suppress(InputError, KeyError):
            address = str(read_result(Path(self.scheduler), dict[str, object], "a scheduler file")["address"])
        host = urlsplit(address if "://" in address else f"tcp://{address}").hostname or ""
        if self.tls or address.startswith("tls://") or host == "localhost" or host.startswith("127.") or host == "::1":
            return ""
        return f"{address} is not encrypted: whoever is on the way or answers there can run any code here; see --tls"


def jobs_of(sources: Sequence[str], columns: Sequence[str]) -> list[Job]:
    """Jobs from recordings (folders, videos, or patterns) and manifests: CSV files with `name` and some of `columns`.

    InputError if a pattern matches nothing, a manifest cannot be used, or a name comes twice.
    """
    jobs: list[Job] = []
    for source in sources:
        if Path(source).suffix == ".csv":
            jobs += _manifest(Path(source), columns)
            continue
        matched = [source] if os.path.exists(source) else sorted(glob(source, recursive=True))
        if not matched:
            raise InputError(source, "matches no recording; expected folders, videos, a pattern, or a manifest .csv")
        jobs += [Job(Path(path).resolve().name, (os.path.abspath(path),), ()) for path in matched]
    sources_by_name: dict[str, str] = {}
    for job in jobs:
        if first := sources_by_name.get(job.name):
            expected = "distinct names, which a manifest can give"
            raise InputError(job.source, f"name {job.name!r} is that of {first} too; expected {expected}")
        sources_by_name[job.name] = job.source
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
            problem = f"{len(fields)} fields under {len(header)} columns"
            raise InputError(file, f"{problem}; expected a field for each column", line)
        row = {key: value for key, value in zip(header, fields, strict=True) if value}
        name = row.pop("name", "")
        if Path(name).name != name or name.startswith(".") or min(name, default="\0") < " ":
            raise InputError(file, f"name {name!r}; expected the name of a new folder", line)
        for key, text in row.items():
            if key in _NUMBERS and not _is_number(text, _NUMBERS[key] == _POSITIVE):
                raise InputError(file, f"{key} {text!r}; expected {_NUMBERS[key]}", line)
        values = {key: tuple(value.split(";")) for key, value in row.items()}
        are_topics = ("left", "right") if "rec" in values else ()
        for key in values.keys() & {*_PATHS} - {*are_topics}:
            values[key] = tuple(os.path.abspath(file.parent / path) for path in values[key])
        rec = values.pop("rec", ())
        options = [word for key, words in values.items() for word in (f"--{key.replace('_', '-')}", *words)]
        yield Job(name, rec, tuple(options), f"{file}:{line}")


def _is_number(text: str, positive: bool) -> bool:
    """Whether a text is a finite number that is positive, or not negative."""
    try:
        return finite(text) > 0 if positive else finite(text) >= 0
    except ValueError:
        return False


def run_batch(
    jobs: Sequence[Job], task: Task, workers: int, cluster: Cluster | None = None, parquet: bool = False
) -> list[dict[str, object]]:
    """Run the unfinished jobs. Returns one row per job, in job order (also written to batch.csv).

    A recording that cannot be used does not stop the others. The results do not depend on the machine. Learning also
    writes the sum of all memories, memory.npz.

    `workers`: processes on this machine; `cluster`: runs the jobs instead, OSError if it does not answer; `parquet`:
    also write batch.parquet (extra `parquet`). InputError if another batch is writing to the folder or was begun there
    with other options, or a name is that of a file of the batch.
    """
    _check(jobs, task, workers)
    with locked_folder(task.out):
        if parquet:
            require_pyarrow()  # before hours of work
        _begin(task, jobs)
        reasons = _run(jobs, task, workers, cluster)
        return _write_results(jobs, task, reasons, parquet)


def run_shard(jobs: Sequence[Job], task: Task, workers: int, shard: tuple[int, int]) -> list[dict[str, object]]:
    """Run the unfinished jobs of shard i of n: the i-th and every n-th after it. Returns their rows.

    Any number of shards may run at a time. Reasons of failures are kept in NAME.failed, for `collect`. InputError as
    for `run_batch`.
    """
    _check(jobs, task, workers)
    while True:
        try:
            with locked_folder(task.out):
                _begin(task, jobs)
            break
        except InputError as error:  # another shard begins
            if not str(error).endswith(BUSY):
                raise
            time.sleep(_BUSY_S)
    chosen = jobs[shard[0] - 1 :: shard[1]]
    reasons = _run(chosen, task, workers)
    for job, reason in zip(chosen, reasons, strict=True):
        task.failure(job).unlink(missing_ok=True)
        if reason:
            with whole_file(task.failure(job)) as partial:
                partial.write_text(reason + "\n", encoding="utf-8", errors="surrogateescape")
    return [task.row(job, reason) for job, reason in zip(chosen, reasons, strict=True)]


def collect(jobs: Sequence[Job], task: Task, parquet: bool = False) -> list[dict[str, object]]:
    """Write what `run_batch` writes of the results that are there; a job without a result has failed."""
    _check(jobs, task)
    with locked_folder(task.out):
        _begin(task, jobs)
        return _write_results(jobs, task, [task.kept_reason(job) for job in jobs], parquet)


def _check(jobs: Sequence[Job], task: Task, workers: int = 1) -> None:
    if workers < 1:
        raise InputError("batch", f"{workers} workers; expected at least 1")
    for job in jobs:
        if (name := task.result(job).name) in _OWN:
            raise InputError(job.source, f"a result called {name}; expected none of {', '.join(_OWN)}")


def _begin(task: Task, jobs: Sequence[Job]) -> None:
    """Note the options and the recordings in the folder.

    InputError if it was begun with other options, holds the result of another recording of the same name, or is not of
    a batch and holds files that this one would replace.
    """
    settings = task.out / SETTINGS
    requested = [task.command, *task.options]
    words = {job.name: [*job.rec, *job.options] for job in jobs}
    noted: dict[str, list[str]] = {}
    if settings.exists():
        begun = read_result(settings, list[str | dict[str, list[str]]], "the settings of a batch, or another folder")
        noted = next((entry for entry in begun if isinstance(entry, dict)), noted)
        if difference := _difference([word for word in begun if isinstance(word, str)], requested):
            raise InputError(task.out, f"was begun {difference}; expected the same options, or another folder")
    elif others := [name for name in _OWN if (task.out / name).exists()]:
        raise InputError(task.out, f"already holds {others[0]}; expected a new folder, or one of a batch")
    for job in jobs:
        if noted.get(job.name, words[job.name]) != words[job.name] and task.is_done(job):
            reason = f"{task.result(job)} is of {shlex.join(noted[job.name])}, not of {shlex.join(words[job.name])}"
            raise InputError(job.source, f"{reason}; expected another name, or another --out")
    if not words.items() <= noted.items():
        with whole_file(settings) as partial:
            partial.write_text(json.dumps([*requested, noted | words]) + "\n")


def _run(jobs: Sequence[Job], task: Task, workers: int, cluster: Cluster | None = None) -> list[str]:
    """`_do` every job; returns the reasons of failures, in their order."""
    task = replace(task, out=task.out.resolve())
    with progress(total=len(jobs), desc="batch", unit="recording") as bar:
        if cluster:
            return _on_cluster(cluster, jobs, task, bar.update)
        reasons = []
        with ExitStack() as stack:
            idle: SimpleQueue[Starter] = SimpleQueue()
            for _ in range(workers):
                idle.put(stack.enter_context(Starter()))

            def do(job: Job) -> str:
                starter = idle.get()
                try:
                    return _do(job, task, starter)
                finally:
                    idle.put(starter)

            pool = stack.enter_context(ThreadPoolExecutor(workers))
            for reason in pool.map(do, jobs):
                reasons.append(reason)
                bar.update()
        return reasons


def _write_results(jobs: Sequence[Job], task: Task, reasons: Sequence[str], parquet: bool) -> list[dict[str, object]]:
    """Write batch.csv and the sum of all memories; returns the rows."""
    rows = [task.row(job, reason) for job, reason in zip(jobs, reasons, strict=True)]
    out = task.out
    if task.command == "learn":
        _add_up([task.result(job) for job, row in zip(jobs, rows, strict=True) if row["status"] == "done"], out)
    with whole_file(out / BATCH) as partial:
        filled = (["" if value is None else value for value in row.values()] for row in rows)
        write_table(partial, tuple(_TABLES[task.command]), filled)
    if parquet:
        with whole_file(out / "batch.parquet") as partial:
            write_parquet(partial, _TABLES[task.command], rows)
    return rows


def _difference(begun: Sequence[str], requested: Sequence[str]) -> str:
    """The difference of two batches' options: "with --order 4", "without --smooth"; "" if they are the same."""
    if begun[:1] != requested[:1]:
        return f"{'with' if begun[:1] == ['learn'] else 'without'} --learn"
    old, new = (
        list(filter(None, re.split(" ?(?=--)", re.sub(r"(--[\w-]+)=", r"\1 ", shlex.join(words[1:])))))
        for words in (begun, requested)
    )
    if removed := [option for option in old if option not in new]:
        return f"with {' '.join(removed)}"
    added = [option for option in new if option not in old]
    return f"without {' '.join(added)}" if added else ""


def _add_up(memories: Sequence[Path], out: Path) -> None:
    """Write the sum of memories, no file if there are none."""
    from learning.pps.memory import load_memory, save_memory

    total = None
    for file in memories:
        memory = load_memory(file)
        total = memory if total is None else replace(total, counts=total.counts + memory.counts)
    if total is not None:
        with whole_file(out / MEMORY) as partial:
            save_memory(partial, total)


def _on_cluster(cluster: Cluster, jobs: Sequence[Job], task: Task, advance: Callable[[], object]) -> list[str]:
    """`_do_alone` every job on the workers of a Dask cluster; a job whose worker dies goes to another."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
        from distributed.security import Security
    except ImportError as error:
        expected = "the extra cluster: pip install 'pps-vision[cluster]'"
        raise InputError("batch", f"--scheduler needs Dask; expected {expected}") from error
    address = {"scheduler_file" if Path(cluster.scheduler).is_file() else "address": cluster.scheduler}
    security = None
    if cluster.tls:
        cert, key = cluster.tls / "cert.pem", cluster.tls / "key.pem"
        for file in cert, key:
            check_regular(file, "the certificate or key of the cluster")
        files = {"tls_ca_file": str(cert), "tls_client_cert": str(cert), "tls_client_key": str(key)}
        security = Security(require_encryption=True, **files)  # type: ignore[no-untyped-call]
    with Client(**address, security=security, set_as_default=False) as client:  # type: ignore[no-untyped-call]
        indices = {client.submit(_do_alone, job, task, pure=False): k for k, job in enumerate(jobs)}
        reasons = [""] * len(jobs)
        for future in as_completed(list(indices), loop=client.loop):  # type: ignore[no-untyped-call]
            try:
                reasons[indices[future]] = future.result()
            except KilledWorker as error:
                reasons[indices[future]] = f"the workers that worked on it died: {first_line(error)}"
            advance()
    return reasons


def _do(job: Job, task: Task, starter: Starter) -> str:
    """Run an unfinished job; return the reason of a failure, or "".

    Waits while the process of a killed worker is still ending.
    """
    while (reason := _do_once(job, task, starter)).endswith(BUSY):
        time.sleep(_BUSY_S)
    return reason


def _do_alone(job: Job, task: Task) -> str:
    """`_do` with a new starter."""
    with Starter() as starter:
        return _do(job, task, starter)


def _do_once(job: Job, task: Task, starter: Starter) -> str:
    if task.is_done(job):
        return ""
    words = [task.command, *job.rec, *task.options, *job.options, "--out", str(task.result(job))]
    with TemporaryFile() as stderr:
        code = starter.run(words, stderr, task.stalled_s)
        stderr.seek(0)
        said = stderr.read().decode("utf-8", "replace")
    if code is None:
        return f"no progress for {task.stalled_s:g} s"
    if code < 0:
        return f"ended by signal {-code}"
    if code:
        return _reason(said) or f"ended with exit code {code}"
    return "" if task.is_done(job) else "ended without a result"


def _reason(stderr: str) -> str:
    """The last line of a failed command, or the first paragraph in tyro's frame."""
    _, frame, framed = stderr.partition("╭")
    if frame:
        return " ".join(takewhile(bool, (line.strip(" │─╰╯") for line in framed.splitlines()[1:])))
    lines = map(str.strip, reversed(stderr.splitlines()))
    return next(filter(None, lines), "").removeprefix("pps-vision: ")
