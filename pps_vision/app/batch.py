"""Track many recordings, each in a process of its own: `pps-vision batch`.

A recording is finished when its folder is there, since `track` writes it whole or not at all; so a batch that was
killed is continued by running it again.
"""

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from glob import glob
from pathlib import Path

from tqdm import tqdm

from pps_vision.errors import InputError
from pps_vision.recordings.outputs import locked_folder, whole_file
from pps_vision.recordings.tables import write_table
from pps_vision.recordings.text import read_lines

TABLE = ("name", "status", "pairs", "frames", "tracked_share", "position_rms_mm", "ms_per_pair", "reason")
SETTINGS = "settings.json"


@dataclass(frozen=True)
class Job:
    """One recording: the name of its folder of results, and what `pps-vision track` is given for it."""

    name: str
    words: tuple[str, ...]
    folder: Path
    """Where relative paths begin."""


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
        jobs += [Job(Path(path).resolve().name, (path,), Path.cwd()) for path in matched]
    seen: dict[str, Job] = {}
    for job in jobs:
        if job.name in seen:
            both = f"{' '.join(seen[job.name].words)} and {' '.join(job.words)}"
            raise InputError(job.name, f"is the name of {both}; expected a manifest with distinct names")
        seen[job.name] = job
    return jobs


def _manifest(file: Path, columns: Sequence[str]) -> Iterator[Job]:
    expected = f"columns name and some of {', '.join(columns)}"
    reader = csv.DictReader(read_lines(file, expected))
    header = reader.fieldnames or []
    if "name" not in header or not set(header) <= {"name", *columns}:
        raise InputError(file, f"columns {','.join(map(str, header))}; expected {expected}", 1)
    for row in reader:
        name = row["name"] or ""
        if None in row or not name or Path(name).name != name or name.startswith("."):
            raise InputError(
                file, f"row {row}; expected {expected}, the name being that of a new folder", reader.line_num
            )
        options = [(key, (row[key] or "").split(";")) for key in columns if row.get(key)]
        words = [word for key, given in options for word in (given if key == "rec" else (_flag(key), *given))]
        yield Job(name, tuple(words), file.resolve().parent)


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def run_batch(jobs: Sequence[Job], options: Sequence[str], out: Path, workers: int) -> list[dict[str, object]]:
    """Track what is not finished and return a row of `TABLE` for each job, in their order; they are in batch.csv too.

    A recording that cannot be tracked fails alone.  The results do not depend on `workers`.

    Raises:
        InputError: Another batch is writing to the folder, or has begun there with other options.
    """
    if workers < 1:
        raise InputError("batch", f"{workers} workers; expected at least 1")
    with locked_folder(out) as held:
        settings = out / SETTINGS
        begun_with = json.dumps(list(options)) + "\n"
        if not settings.exists():
            with whole_file(settings) as partial:
                partial.write_text(begun_with)
        elif settings.read_text() != begun_with:
            found = f"is not {begun_with.strip()}"
            raise InputError(
                settings, f"{found}; expected the options that this folder was begun with, or another folder"
            )

        def track(job: Job) -> str:
            return _track(job, options, out, held)

        with ThreadPoolExecutor(workers) as pool:
            reasons = list(tqdm(pool.map(track, jobs), total=len(jobs), desc="batch", unit="recording", disable=None))
        rows = [_row(job, out, reason) for job, reason in zip(jobs, reasons, strict=True)]
        with whole_file(out / "batch.csv") as partial:
            write_table(partial, TABLE, ([row[key] for key in TABLE] for row in rows))
    return rows


def _track(job: Job, options: Sequence[str], out: Path, held: int) -> str:
    """Track one recording unless it is finished; return why it failed, or ""."""
    if (out / job.name / "summary.json").exists():
        return ""
    command = [
        sys.executable,
        "-m",
        "pps_vision",
        "track",
        *job.words,
        *options,
        "--out",
        str(out.resolve() / job.name),
    ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    # What survives this process holds the lock on.
    done = subprocess.run(
        command, cwd=job.folder, env=environment, capture_output=True, text=True, errors="replace", pass_fds=[held]
    )
    if done.returncode < 0:
        return f"ended by signal {-done.returncode}"
    if done.returncode == 0:
        return ""
    last = done.stderr.strip().splitlines()[-1:]
    return last[0].removeprefix("pps-vision: ") if last else f"ended with exit code {done.returncode}"


def _row(job: Job, out: Path, reason: str) -> dict[str, object]:
    row: dict[str, object] = dict.fromkeys(TABLE, "")
    if reason:
        return row | {"name": job.name, "status": "failed", "reason": reason}
    summary = json.loads((out / job.name / "summary.json").read_text())
    frames = summary["frames"]
    return row | {
        "name": job.name,
        "status": "done",
        "pairs": summary["pairs"],
        "frames": frames,
        "tracked_share": summary["status"]["tracking"] / frames,
        "position_rms_mm": summary.get("errors", {}).get("position_rms_mm") or "",
        "ms_per_pair": summary["ms_per_pair"]["total"]["median_ms"],
    }
