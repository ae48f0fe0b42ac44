"""Track one object in the images of an uncalibrated camera, given its box in the first image."""

import math
from dataclasses import replace
from typing import Literal, NamedTuple, Protocol

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.types import Array, Image
from tracking.image_tracker import MIN_SCORE, ImageTracker
from tracking.masks import BoxPx
from tracking.outline import Optics
from tracking.particle_filter import BESIDE_PX, Evidence, ParticleFilterParams, disc, posterior, scores

_STD_POSITION = 0.25  # of the noise of the autoregression, in object sizes
_STD_SCALE = 0.04  # relative
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
    """Colour particle filter (R): particles of position and scale, driven by second-order autoregression.

    Score: similarity of the colours times ratio of the areas; where the object is partly hidden, its visible share.
    """

    def __init__(self, image: Image, box_px: BoxPx, params: ParticleFilterParams, rng: np.random.Generator) -> None:
        _check(image, box_px)
        self._params = params
        self._rng = rng
        optics = assumed_optics(image.shape[1], image.shape[0])
        self._tracker = ImageTracker(optics)
        angle_rad = 0.5 * math.sqrt(box_px[2] * box_px[3]) / optics.camera.focal_px
        self._target = self._tracker.start(image, box_px, angle_rad)
        self._box_px = box_px
        x, y, w, h = box_px
        self._center: Array = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        self._shift: Array = np.zeros(2)

    @property
    def similarity(self) -> float:
        """Bhattacharyya coefficient of the colours of the object and of its surroundings."""
        return self._target.model.similarity(self._target.model.background)

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        target = self._target
        std_px = _STD_POSITION * target.size
        predicted = self._center + self._shift
        examined = self._tracker.examine(target, image, predicted, 2 * std_px, None, "colour")
        if examined is None:
            return BoxDetection(self._box_px, 0.0)
        center, fill = self._located(examined.evidence, predicted, std_px)
        detected = self._tracker.detect(target, image, examined, center, by_color=True)
        if detected is not None:
            target, detection, _ = detected
            self._target = replace(target, angle_rad=detection.outline.angular_radius_rad / target.ratio)
            center = detection.outline.center_px
            self._box_px, score = detection.box_px, detection.score
        elif fill > MIN_SCORE:
            w, h = target.box
            self._box_px, score = (center[0] - (w - 1) / 2, center[1] - (h - 1) / 2, w, h), fill
        else:
            return BoxDetection(self._box_px, 0.0)
        self._shift = center - self._center
        self._center = center
        return BoxDetection(self._box_px, score)

    def _located(self, evidence: Evidence, predicted: Array, std_px: float) -> tuple[Array, float]:
        """Centre (2,) px of the particles, predicted ± `std_px`, and the visible share of the object there."""
        sides = 0.5 * np.array(self._target.box)
        template = disc()
        inside, edge = sides * template.inside, sides * template.edge
        points = inside, edge - BESIDE_PX * template.outward, edge + BESIDE_PX * template.outward

        def scores_at(x: Array) -> tuple[Array, Array]:
            centers = predicted + std_px * x[:, :2]
            scales = np.exp(_STD_SCALE * x[:, 2])
            return scores(evidence.pixels, evidence.corner, evidence.size, points, centers, scales)

        mean, _ = posterior(self._params, 3, lambda x: scores_at(x)[0], self._rng)
        center: Array = predicted + std_px * mean[:2]
        return center, float(scores_at(mean[None])[1][0])


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
