"""`pps-vision evaluate`: the errors of one or several trackers against the truth."""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from pps_vision.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Evaluate:
    """Compare paths, or boxes, with the true ones, the last file: a row of a table for each.

    Paths are trajectory.csv of `track`, truth.csv, any CSV with the columns stamp_s, x_m, y_m and z_m, TUM's form
    (stamp x y z …), or Anipose's table of one point.  Coverage and NEES need the covariance columns of trajectory.csv.
    Boxes are in the form of `track2d`, MOTChallenge, OTB (x, y, w, h) or VOT (polygons).
    """

    files: Positional[tuple[Path, ...]]
    """TRACK … TRUTH."""
    boxes: bool = False
    """The files hold boxes in images."""
    first_px: Literal[0, 1] | None = None
    """Coordinate of the first pixel in boxes without a header; by default 1 (MOTChallenge, OTB), 0 for polygons
    (VOT)."""
    lag: bool = False
    """Estimate the delay of each path's stamps and correct it."""
    align: bool = False
    """Rotate and shift each path onto the truth first: for another root frame."""
    fps: float | None = None
    """Frames per second of Anipose's tables."""
    track_id: int | None = None
    """Number of the track to score where trajectory.csv holds several; default: the attended one of each pair."""
    json: bool = False
    """Print JSON instead."""
    figure: Path | None = None
    """Also draw the errors of all, or for boxes the success and precision curves, into this file (.png, .pdf, .svg)."""

    def run(self) -> None:
        from pps_vision import __version__
        from pps_vision.recordings.atomic_write import json_text, whole_file

        if len(self.files) < 2:
            raise InputError("evaluate", f"{len(self.files)} files; expected TRACK … TRUTH")
        of_paths = ("lag", "align", "fps", "track_id")
        for name in of_paths if self.boxes else ("first_px",):
            if getattr(self, name) != getattr(Evaluate, name):
                where, other = ("with", "without") if self.boxes else ("without", "with")
                option = f"--{name.replace('_', '-')}"
                raise InputError("evaluate", f"{option} {where} --boxes; expected it only {other}")
        with whole_file(self.figure, self.files) if self.figure else nullcontext() as partial:
            scores, draw = self._score()
            if partial:
                from pps_vision.app.report.page import save

                save(draw(), partial)
        if self.json:
            print(json_text([score | {"version": __version__} for score in scores]))
            return
        columns = list(scores[0])
        rows = [columns, *([_text(score[key]) for key in columns] for score in scores)]
        widths = [max(len(row[k]) for row in rows) for k in range(len(columns))]
        for row in rows:
            print("  ".join([row[0].ljust(widths[0]), *(f.rjust(w) for f, w in zip(row[1:], widths[1:], strict=True))]))

    def _score(self) -> "tuple[list[dict[str, object]], Callable[[], Figure]]":
        """Return the rows of the table, and a function that draws the figure."""
        if self.boxes:
            from pps_vision.app.evaluate_boxes import box_curves, evaluate_boxes, read_boxes

            *tracks, truth = (read_boxes(file, self.first_px) for file in self.files)
            return [asdict(evaluate_boxes(track, truth)) for track in tracks], lambda: box_curves(tracks, truth)
        from pps_vision.app.evaluate import evaluate, path_errors, read_path

        *files, true_file = self.files
        paths = [read_path(file, self.fps, self.track_id) for file in files]
        true_path = read_path(true_file, self.fps)
        for path in (*paths, true_path):
            if n := len(path.missing):
                lines = f"{'from ' * (n > 1)}line {path.missing[0]}"
                print(f"{n} row{'s' * (n > 1)} of {path.name} without a position ({lines})", file=sys.stderr)
        scores = [evaluate(path, true_path, self.lag, self.align) for path in paths]
        return [asdict(score) for score in scores], lambda: path_errors(paths, true_path, scores, self.align)


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
