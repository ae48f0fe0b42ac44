"""Baselines of the image tracker: OpenCV's trackers and CamShift.

Images are RGB; what wants BGR or grey gets it converted, which is part of its time.  All are told the
true box in the first frame, which our tracker finds by itself in the pipeline.
"""

from typing import Literal, Protocol, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import rotation_to
from pps_vision.types import Array, Image

BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
ImageTrackerName = Literal["CamShift", "MOSSE", "KCF", "CSRT"]
_RANGES = (0.0, 180.0, 0.0, 256.0)  # of hue and saturation


class ImageTracker(Protocol):
    """Follows one object in one camera's images."""

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn what is in the box."""

    def step(self, image: Image) -> BoxPx | None:
        """Its box in the next image; None where the tracker says that it has lost it."""
        ...


_SHARES = {"MOSSE": 2.0, "KCF": 1.5, "CSRT": 1.5}


class OpenCVTracker:
    """MOSSE, KCF or CSRT with its default parameters, in the interface that takes boxes of fractions of a pixel.

    Each is given more than the box, because a plain object alone leaves little to correlate with; the middle of what it
    finds is the object.
    """

    def __init__(self, name: Literal["MOSSE", "KCF", "CSRT"]) -> None:
        self._name = name
        self._share = _SHARES[name]
        self._code = cv2.COLOR_RGB2GRAY if name == "MOSSE" else cv2.COLOR_RGB2BGR
        self._tracker: cv2.legacy.Tracker | None = None

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn what is in the box."""
        self._tracker = _opencv(self._name)
        self._tracker.init(cv2.cvtColor(image, self._code), _grown(box, self._share))

    def step(self, image: Image) -> BoxPx | None:
        """ValueError before `start`."""
        if self._tracker is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        found, (x, y, w, h) = self._tracker.update(cv2.cvtColor(image, self._code))
        return _grown((x, y, w, h), 1 / self._share) if found else None


def _grown(box: BoxPx, share: float) -> BoxPx:
    """A box with the same middle and its sides times `share`."""
    x, y, w, h = box
    return x - (share - 1) * w / 2, y - (share - 1) * h / 2, share * w, share * h


def _opencv(name: Literal["MOSSE", "KCF", "CSRT"]) -> cv2.legacy.Tracker:
    if name == "MOSSE":
        return cv2.legacy.TrackerMOSSE.create()
    return cv2.legacy.TrackerKCF.create() if name == "KCF" else cv2.legacy.TrackerCSRT.create()


class HueModel:
    """Share of each hue and saturation, 30×32 bins, that lies in a box's ellipse: a ratio histogram (Swain and Ballard,
    IJCV 1991), with which CamShift does better than with the histogram of OpenCV's example."""

    def __init__(self, image: Image, box: BoxPx) -> None:
        x, y, w, h = (round(value) for value in box)
        crop = np.ascontiguousarray(image[max(y, 0) : y + h, max(x, 0) : x + w])
        inside = cv2.resize(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (64, 64)), crop.shape[1::-1])
        counts, everywhere = (
            np.asarray(cv2.calcHist([cv2.cvtColor(part, cv2.COLOR_RGB2HSV)], [0, 1], mask, [30, 32], _RANGES))
            for part, mask in ((crop, inside), (image, None))
        )
        self._hues = (255 * counts / np.maximum(everywhere, 1)).astype(np.float32)

    def likelihood(self, image: Image) -> NDArray[np.uint8]:
        """(H, W) 0–255."""
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        return np.asarray(cv2.calcBackProject([hsv], [0, 1], self._hues, _RANGES, 1), dtype=np.uint8)


class CamShift:
    """Bradski's, hue back-projection of the whole image, then the window's climb."""

    def __init__(self) -> None:
        self._model: HueModel | None = None
        self._window = (0, 0, 0, 0)

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn the hues in the box."""
        self._model = HueModel(image, box)
        self._window = (round(box[0]), round(box[1]), round(box[2]), round(box[3]))

    def step(self, image: Image) -> BoxPx | None:
        """The blob's centre, with the sides of its ellipse turned upright; None where the window holds nothing."""
        if self._model is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
        blob, window = cv2.CamShift(self._model.likelihood(image), self._window, enough)
        if min(window[2:]) <= 0 or min(blob[1]) <= 0:
            return None
        self._window = (window[0], window[1], window[2], window[3])
        (x, y), (a, b), angle = blob
        c, s = abs(np.cos(np.deg2rad(angle))), abs(np.sin(np.deg2rad(angle)))
        w, h = float(np.hypot(a * c, b * s)), float(np.hypot(a * s, b * c))
        return x - (w - 1) / 2, y - (h - 1) / 2, w, h


def image_tracker(name: ImageTrackerName) -> ImageTracker:
    """A fresh tracker; ValueError for another name."""
    if name == "CamShift":
        return CamShift()
    if name not in get_args(ImageTrackerName):
        raise ValueError(f"image tracker {name!r}; expected one of {', '.join(get_args(ImageTrackerName))}")
    return OpenCVTracker(name)


def middle(box: BoxPx) -> Array:
    """(2,) px, pixel centres being whole numbers."""
    return np.array([box[0] + (box[2] - 1) / 2, box[1] + (box[3] - 1) / 2])


def sphere_box(view: View, center: Array, radius_m: float) -> BoxPx | None:
    """The box around the image of a sphere at `center` (3,), root frame, as far as it lies in the image;
    None where the eye does not see the whole of it in front."""
    away = center - view.center
    sine = radius_m / float(np.linalg.norm(away))
    if sine >= 1:
        return None
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    cosine = float(np.sqrt(1 - sine**2))
    cone = np.stack([sine * np.cos(angle), sine * np.sin(angle), np.full(len(angle), cosine)], axis=1)
    rim = view.project(view.center + cone @ rotation_to(away).T)  # a sphere's rim is a cone of directions
    if not np.all(np.isfinite(rim)):
        return None
    low = np.maximum(rim.min(axis=0), -0.5)
    high = np.minimum(rim.max(axis=0), np.array([view.camera.width, view.camera.height]) - 0.5)
    if np.any(high - low < 2):
        return None
    return (float(low[0] + 0.5), float(low[1] + 0.5), float(high[0] - low[0]), float(high[1] - low[1]))


def intersection_over_union(a: Array, b: Array) -> Array:
    """Return the overlaps (n,) of boxes x, y, w, h (n, 4)."""
    size = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    shared = np.prod(np.maximum(size, 0), axis=1)
    overlap: Array = shared / (np.prod(a[:, 2:], axis=1) + np.prod(b[:, 2:], axis=1) - shared)
    return overlap
