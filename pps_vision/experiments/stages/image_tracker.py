"""Image trackers in one eye, the true box given in the first frame: particles and marker blob beside OpenCV's.

Balls and markers, slow and fixated (5–15 cm/s while the head sways) and fast (60 cm/s, eyes that do not follow: up to
twice the object's size a frame); and a real ball, a pedestrian and a girl.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pps_vision.app.evaluate_boxes import overlaps
from pps_vision.experiments.baselines.image_trackers import (
    NO_NANO,
    BoxPx,
    ImageTracker,
    ImageTrackerName,
    available,
    image_tracker,
    middle,
)
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.recordings import HUES_DEG, moving
from pps_vision.experiments.study import TURNS, Method, Metric, SceneSource, Values, compare, mean, percent
from pps_vision.experiments.tables import Table, judged
from pps_vision.experiments.timing import timed_steps
from pps_vision.recordings.video import open_frames
from pps_vision.types import Image
from rendering.names import MotionName
from tracking.marker import MarkerParams, find_markers
from tracking.particle_filter import ParticleFilterParams
from tracking.track2d import ColorTracker, assumed_optics

DEFAULT = f"{ParticleFilterParams().count} particles"
COUNTS = (2, ParticleFilterParams().count, 1000)  # numbers of particles
BASELINES: tuple[ImageTrackerName, ...] = get_args(ImageTrackerName)
_MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk")
_FAST: dict[str, Any] = {"speed": 0.6, "head": "sway"}
_METRICS = {
    "lost_overlap": Metric("iou", lambda values: 1 - mean(values)),
    "lost_percent": Metric("iou", lambda values: percent(values == 0)),
}


@dataclass(frozen=True)
class BoxedFilm:
    """One eye's images (n), the true boxes (n; None where the object is not in view), and the object's hue."""

    images: tuple[Image, ...]
    boxes: tuple[BoxPx | None, ...]
    hue_deg: float


chart = cells_chart("lost_overlap", "1 − mean IoU", BASELINES, DEFAULT, "time (ms per frame)", 2.6)


def run(study: Any) -> dict[str, Any]:
    """Return by kind of film and tracker: 1 − mean overlap, frames in which the object is lost (no overlap), time."""

    def film(speed: str, source: SceneSource, seed: int) -> BoxedFilm:
        k = seed - study.seed
        stimulus = ("ball", "marker")[k % 2]
        motion = _MOTIONS[k // 2 % len(_MOTIONS)]
        options = _FAST if speed == "fast" else {}
        recording = moving(stimulus, motion, seed, study.seconds, source, **options)
        lefts = tuple(frame.left for frame in recording.frames)
        return BoxedFilm(lefts, tuple(left for left, _ in recording.boxes), HUES_DEG[stimulus])

    cells = compare(study.scenarios(film, ("slow", "fast")), methods(), _METRICS, study.seeds, "CSRT", TURNS)
    present = {name: read for name, read in REAL.items() if (study.data / name).exists()}
    films = {name: lambda _, name=name: REAL[name](study.data / name) for name in present}
    cells |= compare(films, methods(), _METRICS, (study.seed,), "CSRT", TURNS)
    missing = [f"{name}: no {study.data / name}" for name in REAL if name not in present]
    missing += [] if "NanoTrack" in available() else [NO_NANO]
    return {"cells": cells} | ({"not_measured": "; ".join(missing)} if missing else {})


def table(numbers: dict[str, Any]) -> Table:
    """Return mean overlap and lost frames of each tracker by kind of film; bold: less overlap than the best peer."""
    cells = numbers["cells"]
    rows = []
    for name in next(iter(cells.values())):
        row = [name]
        for methods in cells.values():
            best = min(cell["lost_overlap"][0] for peer, cell in methods.items() if peer in BASELINES)
            cell = methods[name]
            text = judged(f"{1 - cell['lost_overlap'][0]:.2f}", name == DEFAULT and cell["lost_overlap"][0] > best)
            row.append(f"{text}, {cell['lost_percent'][0]:.0f} %" if "lost_percent" in cell else text)
        rows.append(row)
    return Table(["mean overlap, frames lost", *cells], rows)


def _real(folder: Path, frames: str, truth: str, delimiter: str | None, first_px: float) -> BoxedFilm:
    """A film whose truth has rows x, y, width, height or the four corners of a polygon; the first pixel is `first_px`.

    The upright box around a polygon counts.
    """
    rows = np.loadtxt(folder / truth, delimiter=delimiter)
    if rows.shape[1] == 8:
        corners = rows.reshape(-1, 4, 2)
        rows = np.hstack([corners.min(axis=1), np.ptp(corners, axis=1)])
    rows = rows - np.array([first_px, first_px, 0, 0])
    boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in rows]
    return BoxedFilm(tuple(image for _, image in open_frames(folder / frames)), tuple(boxes), 0.0)


REAL: dict[str, Callable[[Path], BoxedFilm]] = {
    "vot_ball1": partial(_real, frames="frames", truth="groundtruth.txt", delimiter=",", first_px=0.0),
    "otb_crossing": partial(_real, frames="img", truth="groundtruth_rect.txt", delimiter=None, first_px=1.0),
    "segtrack2_girl": partial(_real, frames="img", truth="groundtruth.txt", delimiter=",", first_px=0.0),
}
"""Real films by the name of their folder."""


def _particles(count: int, film: BoxedFilm, box: BoxPx, seed: int) -> ImageTracker:
    """Our particle filter."""
    return ColorTracker(film.images[0], box, ParticleFilterParams(count=count), np.random.default_rng(seed)).step


def _marker_blob(film: BoxedFilm, box: BoxPx, seed: int) -> ImageTracker:
    """Our marker detector with the object's hue.

    The box is that of the disc with the area of the blob nearest to the last place, or of any blob without one.
    """
    last: BoxPx | None = box
    optics = assumed_optics(film.images[0].shape[1], film.images[0].shape[0])

    def step(image: Image) -> BoxPx | None:
        nonlocal last
        near = None
        if last is not None:
            x, y = middle(last)
            near = float(x), float(y), max(last[2:]) + 3
        blobs = find_markers(MarkerParams(hue_deg=film.hue_deg), image, optics, near)
        last = None
        if blobs:
            side = 2 * float(np.sqrt(blobs[0].area_px / np.pi))
            x, y = blobs[0].center_px - (side - 1) / 2
            last = float(x), float(y), side, side
        return last

    return step


def _opencv(name: ImageTrackerName, film: BoxedFilm, box: BoxPx, seed: int) -> ImageTracker:
    return image_tracker(name, film.images[0], box)


def methods() -> dict[str, Method]:
    """Return all trackers by name."""
    return {
        **{f"{count} particles": partial(_run, partial(_particles, count)) for count in COUNTS},
        "marker blob": partial(_run, _marker_blob),
        **{name: partial(_run, partial(_opencv, name)) for name in available()},
    }


def _run(make: Callable[[BoxedFilm, BoxPx, int], ImageTracker], film: BoxedFilm, seed: int) -> Values:
    """Return the overlap of every frame, 0 where the object is lost, and the times."""
    if film.boxes[0] is None:
        raise ValueError("the object is not in view of the first frame; expected a box to start with")
    boxes, ms = timed_steps(make(film, film.boxes[0], seed), film.images[1:])
    pairs = [(box or [np.nan] * 4, true) for box, true in zip(boxes, film.boxes[1:], strict=True) if true is not None]
    tracked, truth = np.array(pairs).swapaxes(0, 1)
    return {"ms": ms, "iou": np.nan_to_num(np.diagonal(overlaps(tracked, truth)))}
