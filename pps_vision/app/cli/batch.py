"""`pps-vision batch`: track many recordings, or learn from them."""

import re
import sys
import time
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path

from tyro.conf import Positional

from pps_vision.app.cli.options import TrackOptions, command_line, print_skipped, words_of
from pps_vision.errors import InputError
from pps_vision.recordings import MAX_SKEW_S, CalibrationOptions
from pps_vision.recordings.source import SourceOptions

LEARN_COLUMNS = ("rec", "calib", "taxels", "joints", "max_skew_s", "robot", "urdf", "skin")
_TRACK_COLUMNS = ["rec", *(field.name for field in fields(SourceOptions) if field.default is not False)]
_OF_BATCH = ("recordings", "out", "workers", "shard", "collect", "scheduler", "tls", "stalled_s", "learn", "parquet")
_OF_LEARN = ("calib", "max_skew_s", "mode", "seed")


@dataclass(frozen=True)
class Batch(TrackOptions, CalibrationOptions):
    """Track many recordings, or learn from them, each in its own process, into OUT/NAME; batch.csv has a row for each.

    A second run keeps finished recordings and retries failed ones.  A manifest is a CSV file with a column `name` and
    any of the columns rec, left, right, calib, cameras, lens, crop, times, fps, unit_m, joints, max_skew_s (with
    --learn: rec, calib, taxels, joints, max_skew_s, robot, urdf, skin).  Several files in a field are separated by ';',
    paths start at the manifest's folder, and a row's values override the options.
    """

    recordings: Positional[tuple[str, ...]]
    """Folders or videos, patterns of them in quotes, or manifests."""
    out: Path
    """Folder for the results: new, or of a batch with the same options."""
    workers: int = 1
    """Number of parallel processes; the results do not depend on it."""
    shard: str | None = None
    """I/N: only every N-th recording, from the I-th, and no batch.csv: for arrays of jobs (docs/cluster/array.sh)."""
    collect: bool = False
    """Only write batch.csv, report and summed memories of the results that are there, as after the last shard."""
    scheduler: str | None = None
    """Instead of --workers: a Dask cluster, by its scheduler's address (tls://host:8786) or scheduler file; its workers
    see the same files.  A scheduler, and whoever reaches it, can run any code in this process and in its workers."""
    tls: Path | None = None
    """Folder with cert.pem and key.pem, with which scheduler, workers and this process prove that they belong
    together, as docs/cluster/slurm.sh makes them."""
    stalled_s: float = 600.0
    """End a recording that makes no progress for this long."""
    calib: tuple[Path, ...] = ()
    """Calibration for all, as for `track`."""
    fps: float | None = None
    """Frames per second of all, as for `track`."""
    max_skew_s: float = MAX_SKEW_S
    """Left and right images further apart in time are no pair."""
    learn: bool = False
    """Learn PPS maps instead, as `learn`: OUT/NAME.npz is the memory of one recording, OUT/memory.npz that of all."""
    parquet: bool = False
    """Also write batch.parquet (extra `parquet`)."""

    def run(self) -> None:
        """Process the unfinished recordings and print the failures; exit code 1 if some failed, 2 if all failed."""
        from pps_vision.app.batch import Cluster, Task, collect, jobs_of, run_batch, run_shard
        from pps_vision.app.results import BatchSummary
        from pps_vision.app.versions import versions
        from pps_vision.recordings import BATCH, SUMMARY
        from pps_vision.recordings.atomic_write import whole_file, write_json

        started = datetime.now(UTC).isoformat(timespec="seconds")
        start_s = time.monotonic()
        columns = LEARN_COLUMNS if self.learn else _TRACK_COLUMNS
        jobs = jobs_of(self.recordings, columns)
        if not jobs:
            raise InputError("batch", "no recording given; expected one or more")
        if not self.stalled_s > 0:
            raise InputError("batch", f"--stalled-s {self.stalled_s:g}; expected a positive number")
        task = Task("learn" if self.learn else "track", tuple(self._options()), self.out, self.stalled_s)
        shard = self._shard()
        cluster = Cluster(self.scheduler, self.tls) if self.scheduler else None
        if cluster and cluster.warning:
            print_skipped((), [cluster.warning])
        if shard:
            self._say(run_shard(jobs, task, self.workers, shard), self.out)
            return
        if self.collect:
            rows = collect(jobs, task, self.parquet)
        else:
            rows = run_batch(jobs, task, self.workers, cluster, self.parquet)
        failed = sum(row["status"] == "failed" for row in rows)
        summary: BatchSummary = {
            "command": command_line("batch", self),
            "settings": {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("recordings", "out")},
            "recordings": len(rows),
            "failed": failed,
            "started": started,
            "seconds": round(time.monotonic() - start_s, 1),
            "versions": versions(),
        }
        with whole_file(self.out / SUMMARY) as partial:
            write_json(partial, summary)
        if self.report:
            from pps_vision.app.report.tracking import write_batch_report

            write_batch_report(self.out)
        self._say(rows, self.out / BATCH)

    def _shard(self) -> tuple[int, int] | None:
        """Return I and N of --shard; InputError for another form, or for options that go without it."""
        if self.shard is None:
            return None
        if with_it := [f"--{name}" for name in ("collect", "scheduler", "parquet") if getattr(self, name)]:
            raise InputError("batch", f"--shard with {with_it[0]}; expected it without")
        match = re.fullmatch(r"([1-9][0-9]*)/([1-9][0-9]*)", self.shard)
        if match is None or int(match[1]) > int(match[2]):
            raise InputError("batch", f"--shard {self.shard}; expected I/N with I from 1 to N")
        return int(match[1]), int(match[2])

    def _say(self, rows: list[dict[str, object]], written: Path) -> None:
        """Print the failures and the number of results; exit code 1 if some failed, InputError if all failed."""
        failed = [row for row in rows if row["status"] == "failed"]
        for row in failed:
            print(f"failed: {row['name']}: {row['reason']}")
        result = "learned" if self.learn else "tracked"
        print(f"{len(rows) - len(failed)} of {len(rows)} recordings {result} → {written}")
        if rows and len(failed) == len(rows):
            raise InputError("batch", f"none of {len(rows)} recordings could be {result}")
        if failed:
            sys.exit(1)

    def _options(self) -> list[str]:
        """Return the options of `track` or `learn` for every recording, with absolute paths."""
        chosen = [field for field in fields(self) if field.name not in _OF_BATCH]
        if self.learn and (words := words_of(self, [field for field in chosen if field.name not in _OF_LEARN])):
            raise InputError("batch", f"--learn with {words[0]}; expected it without")
        calib = tuple(file.resolve() for file in self.calib)
        files = replace(
            self, calib=calib, map=self.map and self.map.resolve(), memory=self.memory and self.memory.resolve()
        )
        words = words_of(files, chosen)
        return [*words, "--keep-body"] if self.learn else words  # one body for all memories that are summed
