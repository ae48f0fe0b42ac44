"""`pps-vision batch`: track many recordings."""

from dataclasses import dataclass, fields
from pathlib import Path

from tyro.conf import Positional

from pps_vision.app.cli.options import SourceOptions
from pps_vision.errors import InputError
from pps_vision.recordings import Form
from tracking import DEFAULT_ORDER, Mode


@dataclass(frozen=True)
class Batch:
    """Track many recordings, each in a process of its own, into OUT/NAME; batch.csv has a row for each.

    Run again, it does what is left to do: finished recordings are kept, failed ones tried again.  A manifest is a CSV
    file with a column `name`, and of the columns rec, left, right, calib, times, fps, unit_m, joints, max_skew_s those
    that are needed (several files in a field separated by ';', paths from the manifest's folder).
    """

    recordings: Positional[tuple[str, ...]]
    """Folders or videos, patterns of them in quotes, or manifests."""
    out: Path
    """Folder for the results: new, or of a batch with the same options."""
    workers: int = 1
    """Recordings that are tracked at once; the results do not depend on it."""
    scheduler: str | None = None
    """Instead of --workers: a Dask cluster, by its scheduler's address (tcp://host:8786) or scheduler file; its workers
    see the same files."""
    calib: tuple[Path, ...] = ()
    """Calibration for all, as for `track`."""
    fps: float | None = None
    """Frames per second of all, as for `track`."""
    unit_m: float = 1.0
    """Metres per length unit of the calibration."""
    mode: Mode = "generic"
    """generic: whatever moves; marker: a green marker."""
    order: int = DEFAULT_ORDER
    """Order of the Kalman filter, 1–4."""
    smooth: bool = False
    """Smooth the paths with later measurements."""
    also: tuple[Form, ...] = ()
    """Also write the forms of other tools, as for `track`."""
    report: bool = False
    """Also write a report.html for every recording, and one for the batch."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Track what is left to do, and print what failed; exit code 2 if all failed."""
        from pps_vision.app.batch import jobs_of, run_batch

        jobs = jobs_of(self.recordings, [field.name for field in fields(SourceOptions)])
        if not jobs:
            raise InputError("batch", "no recording given; expected one or more")
        rows = run_batch(jobs, self._options(), self.out, self.workers, self.scheduler)
        if self.report:
            from pps_vision.app.report.tracking import write_batch_report

            write_batch_report(self.out)
        failed = [row for row in rows if row["status"] == "failed"]
        for row in failed:
            print(f"failed: {row['name']}: {row['reason']}")
        print(f"{len(rows) - len(failed)} of {len(rows)} recordings tracked → {self.out / 'batch.csv'}")
        if len(failed) == len(rows):
            raise InputError("batch", f"none of {len(rows)} recordings could be tracked")

    def _options(self) -> list[str]:
        """What `track` is given for every recording."""
        words = [f"--mode={self.mode}", f"--order={self.order}", f"--seed={self.seed}", f"--unit-m={self.unit_m}"]
        words += [f"--fps={self.fps}"] if self.fps is not None else []
        words += ["--smooth"] * self.smooth + ["--report"] * self.report + (["--also", *self.also] if self.also else [])
        return words + (["--calib", *(str(file.resolve()) for file in self.calib)] if self.calib else [])
