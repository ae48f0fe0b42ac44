"""Baselines of the image tracker: OpenCV's trackers, CamShift and a hue blob, given the true box in the first image.

Images are RGB; the conversion to BGR or grey is part of a tracker's time.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import rotation_to
from pps_vision.types import Array, Image
from tracking.track2d import nano_tracker

BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
ImageTrackerName = Literal["hue blob", "CamShift", "MOSSE", "KCF", "CSRT", "NanoTrack"]
ImageTracker = Callable[[Image], BoxPx | None]  # the object's box in the next image; None where it is lost
Likelihood = Callable[[Image], NDArray[np.uint8]]  # an image to (H, W) 0–255
_RANGES = (0.0, 180.0, 0.0, 256.0)  # of hue and saturation
_SHARES = {"MOSSE": 2.0, "KCF": 1.5, "CSRT": 1.5}
_MORE_LIKELY = 50  # hue likelihood of the blob's pixels
_NANO = "PPS_VISION_NANO"
NO_NANO = f"NanoTrack: {_NANO} is not set; expected the folder with the two ONNX files of NanoTrack V2"


def available() -> tuple[ImageTrackerName, ...]:
    """Return all trackers; NanoTrack only where `PPS_VISION_NANO` names the folder of its files."""
    names: tuple[ImageTrackerName, ...] = get_args(ImageTrackerName)
    return names if os.environ.get(_NANO) else tuple(name for name in names if name != "NanoTrack")


def image_tracker(name: ImageTrackerName, image: Image, box: BoxPx) -> ImageTracker:
    """Return a tracker of the object in the box, with OpenCV's default parameters.

    MOSSE, KCF and CSRT take boxes of fractions of a pixel. Each is given more than the box, because a plain object
    alone leaves little to correlate with; the object is in the middle of the tracked box.

    Raises:
        InputError: NanoTrack's files are missing or are no such network's.
    """
    if name == "hue blob":
        return _hue_blob(image, box)
    if name == "CamShift":
        return _camshift(image, box)
    if name == "NanoTrack":
        return nano_tracker(image, box, Path(os.environ[_NANO])).step
    share = _SHARES[name]
    code = cv2.COLOR_RGB2GRAY if name == "MOSSE" else cv2.COLOR_RGB2BGR
    tracker: cv2.legacy.Tracker = getattr(cv2.legacy, f"Tracker{name}").create()
    tracker.init(cv2.cvtColor(image, code), _grown(box, share))

    def step(image: Image) -> BoxPx | None:
        is_tracked, (x, y, w, h) = tracker.update(cv2.cvtColor(image, code))
        return _grown((x, y, w, h), 1 / share) if is_tracked else None

    return step


def _grown(box: BoxPx, share: float) -> BoxPx:
    """A box with the same middle and its sides times `share`."""
    x, y, w, h = box
    return x - (share - 1) * w / 2, y - (share - 1) * h / 2, share * w, share * h


def hue_likelihood(image: Image, box: BoxPx) -> Likelihood:
    """Return the likelihood of the hues in a box's ellipse: a ratio histogram (Swain and Ballard, IJCV 1991).

    It is the share of each hue and saturation, 30×32 bins, that lies in the ellipse. CamShift does better with it than
    with the histogram of OpenCV's example.
    """
    x, y, w, h = (round(value) for value in box)
    crop = np.ascontiguousarray(image[max(y, 0) : y + h, max(x, 0) : x + w])
    ellipse = cv2.resize(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (64, 64)), crop.shape[1::-1])
    counts, everywhere = (
        np.asarray(cv2.calcHist([cv2.cvtColor(part, cv2.COLOR_RGB2HSV)], [0, 1], mask, [30, 32], _RANGES))
        for part, mask in ((crop, ellipse), (image, None))
    )
    hues = (255 * counts / np.maximum(everywhere, 1)).astype(np.float32)

    def likelihood(image: Image) -> NDArray[np.uint8]:
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        return np.asarray(cv2.calcBackProject([hsv], [0, 1], hues, _RANGES, 1), dtype=np.uint8)

    return likelihood


def _hue_blob(image: Image, box: BoxPx) -> ImageTracker:
    """The largest region that more likely than not has the hues of a box: a box about its centroid with its sides."""
    likelihood = hue_likelihood(image, box)

    def step(image: Image) -> BoxPx | None:
        is_likely = (likelihood(image) > _MORE_LIKELY).view(np.uint8)
        count, _, stats, centroids = cv2.connectedComponentsWithStats(is_likely)
        if count == 1:
            return None
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        (x, y), (_, _, w, h, _) = np.asarray(centroids)[largest].tolist(), stats[largest].tolist()
        return x - (w - 1) / 2, y - (h - 1) / 2, w, h

    return step


def _camshift(image: Image, box: BoxPx) -> ImageTracker:
    """Bradski's: hue back-projection of the whole image, then the window climbs.

    The box has the blob's centre and the sides of its ellipse turned upright.
    """
    likelihood = hue_likelihood(image, box)
    window = (round(box[0]), round(box[1]), round(box[2]), round(box[3]))
    enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)

    def step(image: Image) -> BoxPx | None:
        nonlocal window
        blob, moved = cv2.CamShift(likelihood(image), window, enough)
        if min(moved[2:]) <= 0 or min(blob[1]) <= 0:
            return None
        window = (moved[0], moved[1], moved[2], moved[3])
        (x, y), (a, b), angle = blob
        c = abs(np.cos(np.deg2rad(angle)))
        s = abs(np.sin(np.deg2rad(angle)))
        w = float(np.hypot(a * c, b * s))
        h = float(np.hypot(a * s, b * c))
        return x - (w - 1) / 2, y - (h - 1) / 2, w, h

    return step


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
