"""Track one object in the images of an uncalibrated camera, given its box in the first image."""

from typing import Literal, NamedTuple, Protocol

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.types import Image
from tracking.image_tracker import BoxPx, ImageTracker, ImageTrackerParams
from tracking.outline import Optics

TrackerName = Literal["colour", "csrt"]
"""The colour particle filter, or OpenCV's CSRT (Lukežič et al., CVPR 2017)."""
MAX_SIMILARITY = 0.5
"""Bhattacharyya coefficient of the colours of an object and of its surroundings above which the particle filter is
unreliable: on 48 composite films its mean IoU was 0.47 above and 0.68 below."""


class BoxDetection(NamedTuple):
    """Box x, y, width, height (px) and score, 0–1; where the object is not detected, its last box and 0."""

    box_px: BoxPx
    score: float


class BoxTracker(Protocol):
    """Tracks one object, whose box in the first image it has been given."""

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        ...


class ColorTracker:
    """The particle filter of the stereo tracker. Score: similarity of the colours times ratio of the areas."""

    def __init__(self, image: Image, box_px: BoxPx, params: ImageTrackerParams, rng: np.random.Generator) -> None:
        _check(image, box_px)
        self._tracker = ImageTracker(params, assumed_optics(image.shape[1], image.shape[0]), rng)
        self._target = self._tracker.start(image, box_px)
        self._box_px = box_px

    @property
    def similarity(self) -> float:
        """Bhattacharyya coefficient of the colours of the object and of its surroundings."""
        return self._target.model.similarity(self._target.model.background)

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        self._target, detection = self._tracker.step(self._target, image)
        if detection is None:
            return BoxDetection(self._box_px, 0.0)
        self._box_px = detection.box_px
        return BoxDetection(detection.box_px, detection.score)


class CsrtTracker:
    """OpenCV's CSRT with its default parameters. Score: 1 where CSRT reports the object, else 0."""

    def __init__(self, image: Image, box_px: BoxPx) -> None:
        _check(image, box_px)
        self._tracker = cv2.legacy.TrackerCSRT.create()
        self._tracker.init(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), box_px)
        self._box_px = box_px

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        is_detected, (x, y, w, h) = self._tracker.update(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        if not is_detected:
            return BoxDetection(self._box_px, 0.0)
        self._box_px = (x, y, w, h)
        return BoxDetection(self._box_px, 1.0)


def assumed_optics(width: int, height: int) -> Optics:
    """Optics of an unknown camera: a lens of about 30° without distortion.

    With a much longer lens the angles would be too small for single precision.
    """
    focal_px = 2.0 * max(width, height)
    return Optics(Camera(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2))


def _check(image: Image, box_px: BoxPx) -> None:
    """Raise InputError for a box that does not lie in the image, or is smaller than 2×2 pixels."""
    height, width = image.shape[:2]
    x, y, w, h = box_px
    if not (w >= 2 and h >= 2 and x >= 0 and y >= 0 and x + w <= width and y + h <= height):
        raise InputError(
            "image tracker", f"first box {x:g} {y:g} {w:g} {h:g}: expected a box inside the {width}×{height} image"
        )
