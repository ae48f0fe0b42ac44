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
from numpy.typing import ArrayLike

from pps_vision.experiments.baselines.image_trackers import (
    BoxPx,
    ImageTracker,
    ImageTrackerName,
    image_tracker,
    intersection_over_union,
    middle,
)
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.recordings import HUES_DEG, moving
from pps_vision.experiments.stages.parameters import StageParameters
from pps_vision.experiments.study import TURNS, Method, Metric, SceneSource, Values, compare, mean, median, percent
from pps_vision.experiments.timing import timed_steps
from pps_vision.recordings.video import open_frames
from pps_vision.types import Image
from rendering.names import MotionName
from tracking.image_tracker import ImageTrackerParams
from tracking.marker import MarkerParams, find_markers
from tracking.track2d import ColorTracker, assumed_optics

DEFAULT = f"{ImageTrackerParams().particles} particles"
COUNTS = (2, ImageTrackerParams().particles, 1000)  # numbers of particles
BASELINES: tuple[ImageTrackerName, ...] = get_args(ImageTrackerName)
_MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk")
_FAST: dict[str, Any] = {"speed": 0.6, "head": "sway"}
_METRICS = {
    "lost_overlap": Metric("iou", lambda values: 1 - mean(values)),
    "held_percent": Metric("held", percent),
    "center_px": Metric("center_px", median),
}


@dataclass(frozen=True)
class BoxedFilm:
    """One eye's images (n), the true boxes (n; None where the object is not in view), and the object's hue."""

    images: tuple[Image, ...]
    boxes: tuple[BoxPx | None, ...]
    hue_deg: float


chart = cells_chart("lost_overlap", "1 − mean IoU", BASELINES, DEFAULT, "time (ms per frame)", 2.6)


def run(study: StageParameters) -> dict[str, Any]:
    """Return by kind of film and tracker: 1 − mean overlap, frames with overlap, centre error, time."""

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
    return {"cells": cells} | ({"not_measured": "; ".join(missing)} if missing else {})


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


def particle_tracker(count: int, seed: int, image: Image, box: BoxPx) -> ImageTracker:
    """Return our particle filter with the interface of the baselines."""
    tracker = ColorTracker(image, box, ImageTrackerParams(particles=count), np.random.default_rng(seed))

    def step(image: Image) -> BoxPx | None:
        detection = tracker.step(image)
        return detection.box_px if detection.score > 0 else None

    return step


def hue_blob(hue_deg: float, image: Image, box: BoxPx) -> ImageTracker:
    """Return our marker detector with a given hue.

    The box is that of the disc with the area of the blob nearest to the last place, or of any blob without one.
    """
    last: BoxPx | None = box
    optics = assumed_optics(image.shape[1], image.shape[0])

    def step(image: Image) -> BoxPx | None:
        nonlocal last
        near = None
        if last is not None:
            x, y = middle(last)
            near = float(x), float(y), max(last[2:]) + 3
        blobs = find_markers(MarkerParams(hue_deg=hue_deg), image, optics, near)
        last = None
        if blobs:
            side = 2 * float(np.sqrt(blobs[0].area_px / np.pi))
            x, y = blobs[0].center_px - (side - 1) / 2
            last = float(x), float(y), side, side
        return last

    return step


def methods() -> dict[str, Method]:
    """Return all trackers by name."""
    return {
        **{f"{n} particles": partial(_run, lambda _, *start, n=n: particle_tracker(n, *start)) for n in COUNTS},
        "marker blob": partial(_run, lambda hue_deg, _, *start: hue_blob(hue_deg, *start)),
        **{name: partial(_run, lambda _, __, *start, name=name: image_tracker(name, *start)) for name in BASELINES},
    }


def _run(make: Callable[[float, int, Image, BoxPx], ImageTracker], film: BoxedFilm, seed: int) -> Values:
    """Return overlap (0 where lost), whether there is any, and the centre error where there is, of every frame."""
    if film.boxes[0] is None:
        raise ValueError("the object is not in view of the first frame; expected a box to start with")
    tracker = make(film.hue_deg, seed, film.images[0], film.boxes[0])
    boxes, ms = timed_steps(tracker, film.images[1:])
    iou: list[float] = []
    center_px: list[float] = []
    for box, true in zip(boxes, film.boxes[1:], strict=True):
        if true is None:
            continue
        iou.append(0.0 if box is None else float(intersection_over_union(np.array([box]), np.array([true]))[0]))
        if box is not None and iou[-1] > 0:
            center_px.append(float(np.linalg.norm(middle(box) - middle(true))))
    values: dict[str, ArrayLike] = {"ms": ms, "iou": iou, "held": np.array(iou) > 0, "center_px": center_px}
    return values
