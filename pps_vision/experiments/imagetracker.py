"""Image trackers in one eye, the true box given in the first frame: our particles and marker blob beside OpenCV's."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.baselines.image_trackers import (
    BoxPx,
    ImageTrackerName,
    image_tracker,
    intersection_over_union,
    middle,
)
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.scenarios import HUES_DEG, moving
from pps_vision.experiments.score import timed_steps
from pps_vision.experiments.study import (
    DATA,
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
from pps_vision.recordings.image_sequence import open_frames
from pps_vision.types import Image
from rendering.names import MotionName
from tracking.image_tracker import BoxTracker, ImageTrackerParams, assumed_optics
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Optics

COUNTS = (50, 100, 500, 1000)
MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk")
DEFAULT = f"{ImageTrackerParams().particles} particles"
BASELINES: tuple[ImageTrackerName, ...] = get_args(ImageTrackerName)
_FAST_M_S = 0.6
_METRICS = {
    "lost_overlap": Metric("iou", lambda values: 1 - mean(values)),
    "held_percent": Metric("held", percent),
    "center_px": Metric("center_px", median),
}


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
    to twice the object's size a frame); and the real ball of vot_ball1.
    """

    n: int = 6
    """Recordings of each kind; balls and markers in turn."""
    seconds: float = 2.5
    """Length of each."""
    data: Path = DATA
    """Folder that holds vot_ball1 (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return by kind of sequence and tracker: lost overlap, frames with the object, centre error, time."""
        scenarios = self.scenarios(self._film, ("slow", "fast"))
        cells = compare(scenarios, methods(), _METRICS, self.seeds, reference="CSRT")
        folder = self.data / "vot_ball1"
        if not folder.exists():
            return {"cells": cells, "skipped": f"vot_ball1: no {folder}"}
        real = compare({"vot_ball1": lambda _: real_ball(folder)}, methods(), _METRICS, (self.seed,), reference="CSRT")
        return {"cells": cells | real}

    def _film(self, speed: str, source: SceneSource, seed: int) -> View:
        k = seed - self.seed
        stimulus, motion = ("ball", "marker")[k % 2], MOTIONS[k // 2 % len(MOTIONS)]
        how: dict[str, Any] = {"speed": _FAST_M_S, "head": "sway"} if speed == "fast" else {}
        recording = moving(stimulus, motion, seed, self.seconds, source, **how)
        lefts = tuple(frame.left for frame in recording.frames)
        return View(lefts, tuple(left for left, _ in recording.boxes), HUES_DEG[stimulus])

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against lost overlap, one panel for each kind of sequence."""
        labels = {"lost_overlap": "1 − mean IoU"}
        return speed_errors(numbers["cells"], labels, BASELINES, DEFAULT, "time (ms per frame)")

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the lost overlap: one row a tracker, one column a kind of sequence."""
        cells = numbers["cells"]
        rows = [[m, *(estimate(cell[m]["lost_overlap"], 2) for cell in cells.values())] for m in methods()]
        return {"": Table(["1 − mean IoU", *cells], rows)}


def real_ball(folder: Path) -> View:
    """Return VOT's ball1, with upright boxes around the annotated polygons; the ball is red."""
    polygons = np.loadtxt(folder / "groundtruth.txt", delimiter=",").reshape(-1, 4, 2)
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in np.hstack([low, high - low])]
    return View(tuple(image for _, image in open_frames(folder / "frames")), tuple(boxes), 0.0)


class _OneEye(Protocol):
    def start(self, image: Image, box: BoxPx) -> None: ...

    def step(self, image: Image) -> BoxPx | None: ...


class Particles:
    """Our particle filter with the interface of the baselines."""

    def __init__(self, count: int, seed: int) -> None:
        params = ImageTrackerParams(particles=count)
        self._tracker = BoxTracker(params, np.random.default_rng(seed))

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn what is in the box."""
        self._tracker.start(image, box)

    def step(self, image: Image) -> BoxPx | None:
        """Return the box; None where the object is not seen."""
        seen = self._tracker.step(image)
        return seen.box_px if seen.score > 0 else None


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
    ours: dict[str, Method] = {f"{n} particles": partial(_run, lambda _, seed, n=n: Particles(n, seed)) for n in COUNTS}
    default: dict[str, Method] = {
        DEFAULT: partial(_run, lambda _, seed: Particles(ImageTrackerParams().particles, seed))
    }
    blob: dict[str, Method] = {"marker blob": partial(_run, lambda view, _: HueBlob(view.hue_deg))}
    return ours | default | blob | {name: partial(_run, lambda _, __, n=name: image_tracker(n)) for name in BASELINES}


def _run(make: Any, view: View, seed: int) -> Values:
    """Return overlap (0 where lost), whether it is held, and the centre error where held, of every frame."""
    tracker: _OneEye = make(view, seed)
    if view.boxes[0] is None:
        raise ValueError("the object is not in view of the first frame; expected a box to start with")
    tracker.start(view.images[0], view.boxes[0])
    found, ms = timed_steps(tracker.step, view.images[1:])
    iou: list[float] = []
    center_px: list[float] = []
    for box, true in zip(found, view.boxes[1:], strict=True):
        if true is None:
            continue
        iou.append(0.0 if box is None else float(intersection_over_union(np.array([box]), np.array([true]))[0]))
        if box is not None and iou[-1] > 0:
            center_px.append(float(np.linalg.norm(middle(box) - middle(true))))
    return {"ms": ms, "iou": iou, "held": np.array(iou) > 0, "center_px": center_px}
