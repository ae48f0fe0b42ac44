"""Track many recordings, each in a process of its own: `pps-vision batch`.

A recording is finished when its folder is there, since `track` writes it whole or not at all; so a batch that was
killed is continued by running it again.
"""

import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from glob import glob
from pathlib import Path

from tqdm import tqdm

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.outputs import BUSY, locked_folder, whole_file
from pps_vision.recordings.tables import write_table
from pps_vision.recordings.text import read_lines

TABLE = ("name", "status", "pairs", "frames", "tracked_share", "position_rms_mm", "ms_per_pair", "reason")
SETTINGS = "settings.json"
_BUSY_S = 0.5  # between two looks at a recording that another run is tracking


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


def run_batch(
    jobs: Sequence[Job], options: Sequence[str], out: Path, workers: int, scheduler: str | None = None
) -> list[dict[str, object]]:
    """Track what is not finished and return a row of `TABLE` for each job, in their order; they are in batch.csv too.

    A recording that cannot be tracked fails alone.  The results do not depend on where they are tracked.

    Args:
        jobs: What to track.
        options: What `pps-vision track` is given for all.
        out: Folder of the results.
        workers: Processes on this machine.
        scheduler: Address or scheduler file of a Dask cluster that does it instead.

    Raises:
        InputError: Another batch is writing to the folder, or has begun there with other options.
        OSError: The cluster does not answer.
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

        with tqdm(total=len(jobs), desc="batch", unit="recording", disable=None) as bar:
            if scheduler:
                reasons = _on_cluster(scheduler, jobs, options, out.resolve(), bar)
            else:
                reasons = []
                with ThreadPoolExecutor(workers) as pool:
                    for reason in pool.map(lambda job: _track(job, options, out, held), jobs):
                        reasons.append(reason)
                        bar.update()
        rows = [_row(job, out, reason) for job, reason in zip(jobs, reasons, strict=True)]
        with whole_file(out / "batch.csv") as partial:
            write_table(partial, TABLE, ([row[key] for key in TABLE] for row in rows))
    return rows


def _on_cluster(scheduler: str, jobs: Sequence[Job], options: Sequence[str], out: Path, bar: tqdm) -> list[str]:
    """`_track` of every job on the workers of a Dask cluster; a job whose worker dies goes to another."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        wanted = "the extra cluster: pip install 'pps-vision[cluster]'"
        raise InputError("batch", f"--scheduler needs Dask; expected {wanted}") from error
    where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
    with Client(**where, set_as_default=False) as client:  # type: ignore[no-untyped-call]
        places = {client.submit(_track, job, options, out, pure=False): place for place, job in enumerate(jobs)}
        reasons = [""] * len(jobs)
        done = as_completed(list(places), loop=client.loop)  # type: ignore[no-untyped-call]
        for future in done:
            try:
                reasons[places[future]] = future.result()
            except KilledWorker as error:
                reasons[places[future]] = f"the workers that tracked it died: {first_line(error)}"
            bar.update()
    return reasons


def _track(job: Job, options: Sequence[str], out: Path, held: int | None = None) -> str:
    """Track one recording unless it is finished; return why it failed, or "".

    What a worker that died has started may still be at it, in which case its end is waited for.
    """
    while (reason := _track_once(job, options, out, held)).endswith(BUSY):
        time.sleep(_BUSY_S)
    return reason


def _track_once(job: Job, options: Sequence[str], out: Path, held: int | None) -> str:
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
        command,
        cwd=job.folder,
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        pass_fds=[] if held is None else [held],
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
