"""`pps-vision evaluate`: the errors of one or several paths against the true one."""

from dataclasses import asdict, dataclass
from pathlib import Path

from tyro.conf import Positional

from pps_vision.errors import InputError


@dataclass(frozen=True)
class Evaluate:
    """Compare paths with the true one, the last file: a row of a table for each.

    Files are trajectory.csv of `track`, truth.csv, any CSV with the columns stamp_s, x_m, y_m and z_m, or TUM's form
    (stamp x y z …).  Coverage and NEES need the covariance columns of trajectory.csv.
    """

    files: Positional[tuple[Path, ...]]
    """TRACK … TRUTH."""
    lag: bool = False
    """Estimate by how much the stamps of each path are late, and correct it."""
    align: bool = False
    """Rotate and shift each path onto the truth first: for another root frame."""
    json: bool = False
    """Print JSON instead."""

    def run(self) -> None:
        """Read, score, print."""
        import json

        from pps_vision.app.evaluate import evaluate, read_path
        from pps_vision.recordings.outputs import plain

        if len(self.files) < 2:
            raise InputError("evaluate", f"{len(self.files)} files; expected TRACK … TRUTH")
        *tracks, truth = (read_path(file) for file in self.files)
        scores = [asdict(evaluate(track, truth, self.lag, self.align)) for track in tracks]
        if self.json:
            print(json.dumps(plain(scores), indent=2, ensure_ascii=False))
            return
        columns = list(scores[0])
        rows = [columns, *([_text(score[key]) for key in columns] for score in scores)]
        widths = [max(len(row[k]) for row in rows) for k in range(len(columns))]
        for row in rows:
            print("  ".join([row[0].ljust(widths[0]), *(f.rjust(w) for f, w in zip(row[1:], widths[1:], strict=True))]))


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
