"""Image trackers in one eye, the true box given in the first frame: ours and a marker blob beside OpenCV's."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, get_args

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pps_vision.experiments.baselines.image_trackers import (
    BoxPx,
    ImageTrackerName,
    image_tracker,
    intersection_over_union,
    middle,
)
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.composites import DIFFICULTIES, composite
from pps_vision.experiments.films.caster import PHOTOS
from pps_vision.experiments.films.recordings import HUES_DEG, moving
from pps_vision.experiments.study import (
    DATA,
    TURNS,
    Method,
    Metric,
    SceneSource,
    TrackingStudy,
    Values,
    compare,
    mean,
    median,
    percent,
)
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed_steps
from pps_vision.recordings.image_sequence import open_frames
from pps_vision.types import Image
from rendering.names import MotionName
from tracking.image_tracker import MIN_SCORE, ImageTrackerParams
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Optics
from tracking.track2d import ColorTracker, assumed_optics

COUNTS = (50, 100, 500, 1000)
MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk")
DEFAULT = f"{ImageTrackerParams().particles} particles"
BASELINES: tuple[ImageTrackerName, ...] = get_args(ImageTrackerName)
_FAST_M_S = 0.6
_METRICS = {
    "lost_overlap": Metric("iou", lambda values: 1 - mean(values)),
    "held_percent": Metric("held", percent),
    "center_px": Metric("center_px", median),
    "low_when_off_percent": Metric("low_when_off", percent),
    "high_when_on_percent": Metric("high_when_on", percent),
}
_OFF, _ON = 0.1, 0.5  # overlaps below and above which a box does not, or does, hold the object
_SURE = 0.5  # score from which a box counts as sure
_FILM_FPS = 40


@dataclass(frozen=True)
class View:
    """One eye's images (n), the true boxes (n; None where the object is not in view), and the object's hue."""

    images: tuple[Image, ...]
    boxes: tuple[BoxPx | None, ...]
    hue_deg: float


@dataclass(frozen=True)
class ImageTracker(TrackingStudy):
    """Particles, marker blob and OpenCV's trackers in one eye, the first box given: time, overlap and centre error.

    Balls and markers, slow and fixated (5–15 cm/s while the head sways) and fast (60 cm/s, eyes that do not follow: up
    to twice the object's size a frame); composite films of textured objects, one difficulty after another; and a real
    ball, a pedestrian and a girl. Scores are judged too: below 0.4 where the box is off, at least 0.5 where it is on.
    """

    n: int = 6
    """Recordings of each kind; balls and markers in turn."""
    seconds: float = 2.5
    """Length of each."""
    data: Path = DATA
    """Folder of the real films and photographs (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return by kind of sequence and tracker: lost overlap, frames with the object, centre error, time."""
        scenarios = self.scenarios(self._film, ("slow", "fast")) | {"composite": self._composite}
        cells = compare(scenarios, methods(), _METRICS, self.seeds, "CSRT", TURNS)
        there = {name: read for name, read in REAL.items() if (self.data / name).exists()}
        films = {name: lambda _, name=name: REAL[name](self.data / name) for name in there}
        real = compare(films, methods(), _METRICS, (self.seed,), "CSRT", TURNS)
        skipped = [f"{name}: no {self.data / name}" for name in REAL if name not in there]
        return {"cells": cells | real} | ({"skipped": "; ".join(skipped)} if skipped else {})

    def _film(self, speed: str, source: SceneSource, seed: int) -> View:
        k = seed - self.seed
        stimulus, motion = ("ball", "marker")[k % 2], MOTIONS[k // 2 % len(MOTIONS)]
        how: dict[str, Any] = {"speed": _FAST_M_S, "head": "sway"} if speed == "fast" else {}
        recording = moving(stimulus, motion, seed, self.seconds, source, **how)
        lefts = tuple(frame.left for frame in recording.frames)
        return View(lefts, tuple(left for left, _ in recording.boxes), HUES_DEG[stimulus])

    def _composite(self, seed: int) -> View:
        difficulty, rng = DIFFICULTIES[(seed - self.seed) % len(DIFFICULTIES)], np.random.default_rng((16, seed))
        film = composite(difficulty, tuple(range(len(PHOTOS))), self.data, rng, round(_FILM_FPS * self.seconds))
        boxes = [box if share > 0.5 else None for box, share in zip(film.boxes, film.visible, strict=True)]
        return View(film.images, tuple(boxes), 0.0)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against lost overlap, one panel for each kind of sequence; with the default number of particles."""
        others = {f"{n} particles" for n in COUNTS}
        cells = {k: {m: cell for m, cell in of.items() if m not in others} for k, of in numbers["cells"].items()}
        return speed_errors(cells, "lost_overlap", "1 − mean IoU", BASELINES, DEFAULT, "time (ms per frame)", 2.6)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the lost overlap: one row a tracker, one column a kind of film; and how far to trust scores."""
        cells = numbers["cells"]
        rows = [
            [m, *(estimate(cell[m]["lost_overlap"], 2) for cell in cells.values())] for m in next(iter(cells.values()))
        ]
        scores = [
            [kind, *(estimate(cell[DEFAULT][key]) for key in ("low_when_off_percent", "high_when_on_percent"))]
            for kind, cell in cells.items()
        ]
        off, on = f"score < {MIN_SCORE:g} where IoU < {_OFF:g} (%)", f"≥ {_SURE:g} where IoU ≥ {_ON:g} (%)"
        header = ["scenes", off, on]
        return {"": Table(["1 − mean IoU", *cells], rows), "scores": Table(header, scores)}


def real_ball(folder: Path) -> View:
    """Return VOT's ball1, with upright boxes around the annotated polygons; the ball is red."""
    polygons = np.loadtxt(folder / "groundtruth.txt", delimiter=",").reshape(-1, 4, 2)
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in np.hstack([low, high - low])]
    return View(tuple(image for _, image in open_frames(folder / "frames")), tuple(boxes), 0.0)


def _upright(folder: Path, truth: str, delimiter: str | None, first: float) -> View:
    """Return a film whose file of the truth has rows x, y, width, height; the first pixel is `first`."""
    rows = np.loadtxt(folder / truth, delimiter=delimiter) - np.array([first, first, 0, 0])
    boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in rows]
    return View(tuple(image for _, image in open_frames(folder / "img")), tuple(boxes), 0.0)


REAL: dict[str, Callable[[Path], View]] = {
    "vot_ball1": real_ball,
    "otb_crossing": partial(_upright, truth="groundtruth_rect.txt", delimiter=None, first=1.0),
    "segtrack2_girl": partial(_upright, truth="groundtruth.txt", delimiter=",", first=0.0),
}
"""Real films by the name of their folder."""


class _OneEye(Protocol):
    def start(self, image: Image, box: BoxPx) -> None: ...

    def step(self, image: Image) -> BoxPx | None: ...


class ParticleTracker:
    """Our particle filter with the interface of the baselines."""

    def __init__(self, count: int, seed: int) -> None:
        self._params, self._rng = ImageTrackerParams(particles=count), np.random.default_rng(seed)
        self._tracker: ColorTracker | None = None
        self.scores: list[float] = []

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn what is in the box."""
        self._tracker = ColorTracker(image, box, self._params, self._rng)

    def step(self, image: Image) -> BoxPx | None:
        """Return the box; None where the object is not seen."""
        if self._tracker is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        detection = self._tracker.step(image)
        self.scores.append(detection.score)
        return detection.box_px if detection.score > 0 else None


@dataclass
class HueBlob:
    """Our marker detector: the hue is told; the blob nearest to the last place, anywhere when there is none."""

    hue_deg: float
    last: BoxPx | None = None
    optics: Optics | None = None

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn the place."""
        self.last, self.optics = box, assumed_optics(image.shape[1], image.shape[0])

    def step(self, image: Image) -> BoxPx | None:
        """Return the box of the disc that has the blob's area."""
        if self.optics is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        params, near = MarkerParams(hue_deg=self.hue_deg), None
        if self.last is not None:
            x, y = middle(self.last)
            near = float(x), float(y), max(self.last[2:]) + 3
        found = find_markers(params, image, self.optics, near)
        self.last = None
        if found:
            side = 2 * float(np.sqrt(found[0].area_px / np.pi))
            x, y = found[0].center_px - (side - 1) / 2
            self.last = float(x), float(y), side, side
        return self.last


def methods() -> dict[str, Method]:
    """Return everything that is compared, by name."""
    ours: dict[str, Method] = {
        f"{n} particles": partial(_run, lambda _, seed, n=n: ParticleTracker(n, seed)) for n in COUNTS
    }
    count = ImageTrackerParams().particles
    default: dict[str, Method] = {DEFAULT: partial(_run, lambda _, seed: ParticleTracker(count, seed))}
    blob: dict[str, Method] = {"marker blob": partial(_run, lambda view, _: HueBlob(view.hue_deg))}
    return ours | default | blob | {name: partial(_run, lambda _, __, n=name: image_tracker(n)) for name in BASELINES}


def _run(make: Any, view: View, seed: int) -> Values:
    """Return overlap (0 where lost), whether it is held, and the centre error where held, of every frame."""
    tracker: _OneEye = make(view, seed)
    if view.boxes[0] is None:
        raise ValueError("the object is not in view of the first frame; expected a box to start with")
    tracker.start(view.images[0], view.boxes[0])
    found, ms = timed_steps(tracker.step, view.images[1:])
    scores = tracker.scores if isinstance(tracker, ParticleTracker) else []
    iou: list[float] = []
    center_px: list[float] = []
    for box, true in zip(found, view.boxes[1:], strict=True):
        if true is None:
            continue
        iou.append(0.0 if box is None else float(intersection_over_union(np.array([box]), np.array([true]))[0]))
        if box is not None and iou[-1] > 0:
            center_px.append(float(np.linalg.norm(middle(box) - middle(true))))
    values: dict[str, ArrayLike] = {"ms": ms, "iou": iou, "held": np.array(iou) > 0, "center_px": center_px}
    if scores:
        score = np.array([one for one, true in zip(scores, view.boxes[1:], strict=True) if true is not None])
        off, on = np.array(iou) < _OFF, np.array(iou) >= _ON
        values |= {"low_when_off": score[off] < MIN_SCORE, "high_when_on": score[on] >= _SURE}
    return values
