"""Track one object in the images of an uncalibrated camera, given its box in the first image.

Three trackers, and one score for all: the probability that the box still holds the object.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import Camera
from pps_vision.geometry.masks import BoxPx
from pps_vision.types import Array, Image
from tracking.image_tracker import MIN_SCORE, RATE, ImageTracker
from tracking.outline import Optics
from tracking.particle_filter import BESIDE_PX, Evidence, ParticleFilterParams, disc, posterior, scores

_STD_POSITION = 0.25  # noise of the autoregression, in object sizes
_STD_SCALE = 0.04  # relative
MAX_SIMILARITY = 0.5
"""Bhattacharyya coefficient of the colours of an object and of its surroundings above which the particle filter is
unreliable: on 48 composite films its mean IoU was 0.47 above and 0.68 below."""
_SIDE_PX = 24  # geometric mean of the sides that a box is resampled to
_AROUND = 2.0  # size of the surroundings whose colours are compared, in boxes
_REGION = 5  # size of the region that is searched for the object, in boxes
_TOLERANCE = 0.25  # error of the box, in boxes, that is forgiven
_ELSEWHERE = 0.75  # distance, in boxes, from which a place is another one
_EPSILON = 0.02  # keeps the contrasts finite
_LEARNED = 0.8  # score from which the object's colours and texture are updated
_WEIGHTS = 4.8, 1.3, -1.5  # contrasts of colours and texture, and constant
"""Logistic regression of an IoU of at least ½ on 5500 frames of three real sequences and 29 composite films. The colour
particle filter and CSRT placed the boxes, in some runs after they were put onto the background."""


class BoxDetection(NamedTuple):
    """Box x, y, width, height (px) and score, 0–1; where the tracker reports no object, its last box and 0."""

    box_px: BoxPx
    score: float


class BoxTracker(Protocol):
    """Tracks one object, whose box in the first image it has been given."""

    def step(self, image: Image) -> BoxPx | None:
        """The object's box in the next image; None where the tracker reports none."""
        ...


class ColorTracker:
    """Colour particle filter (R): particles of position and scale, driven by second-order autoregression."""

    def __init__(self, image: Image, box_px: BoxPx, params: ParticleFilterParams, rng: np.random.Generator) -> None:
        _check(image, box_px)
        self._params = params
        self._rng = rng
        optics = assumed_optics(image.shape[1], image.shape[0])
        self._tracker = ImageTracker(optics)
        angle_rad = 0.5 * math.sqrt(box_px[2] * box_px[3]) / optics.camera.focal_px
        self._target = self._tracker.start(image, box_px, angle_rad)
        x, y, w, h = box_px
        self._center: Array = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        self._shift: Array = np.zeros(2)

    @property
    def similarity(self) -> float:
        """Bhattacharyya coefficient of the colours of the object and of its surroundings."""
        return self._target.model.similarity(self._target.model.background)

    def step(self, image: Image) -> BoxPx | None:
        """The object's box in the next image."""
        target = self._target
        std_px = _STD_POSITION * target.size
        predicted = self._center + self._shift
        examined = self._tracker.examine(target, image, predicted, 2 * std_px, None, "colour")
        if examined is None:
            return None
        center, fill = self._located(examined.evidence, predicted, std_px)
        detected = self._tracker.detect(target, image, examined, center, by_color=True)
        if detected is not None:
            target, detection, _ = detected
            self._target = replace(target, angle_rad=detection.outline.angular_radius_rad / target.ratio)
            center = detection.outline.center_px
            box_px = detection.box_px
        elif fill > MIN_SCORE:
            w, h = target.box
            box_px = center[0] - (w - 1) / 2, center[1] - (h - 1) / 2, w, h
        else:
            return None
        self._shift = center - self._center
        self._center = center
        return box_px

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


class OpenCvTracker:
    """A tracker of OpenCV's, which takes BGR images."""

    def __init__(self, tracker: Any, image: Image, box_px: BoxPx) -> None:
        _check(image, box_px)
        self._tracker = tracker
        self._tracker.init(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), box_px)

    def step(self, image: Image) -> BoxPx | None:
        """The object's box in the next image; None where the tracker reports none."""
        is_detected, (x, y, w, h) = self._tracker.update(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        return (x, y, w, h) if is_detected else None


def csrt_tracker(image: Image, box_px: BoxPx) -> OpenCvTracker:
    """Return OpenCV's CSRT with its default parameters (Lukežič et al., CVPR 2017)."""
    return OpenCvTracker(cv2.legacy.TrackerCSRT.create(), image, box_px)


def nano_tracker(image: Image, box_px: BoxPx, weights: Path) -> OpenCvTracker:
    """Return OpenCV's NanoTrack, whose box in the first image has whole numbers.

    Args:
        image: The first image.
        box_px: The object's box.
        weights: Folder with the two ONNX files of the network, *backbone* and *head*.

    Raises:
        InputError: Files are missing or are no such network's.
    """
    params = cv2.TrackerNano_Params()  # type: ignore[attr-defined]
    for name, part in (("backbone", "backbone"), ("neckhead", "head")):
        files = sorted(weights.glob(f"*{part}*.onnx"))
        if len(files) != 1:
            found = ", ".join(file.name for file in files) or "none"
            raise InputError(str(weights), f"found {found}; expected one file *{part}*.onnx of NanoTrack")
        setattr(params, name, str(files[0]))
    x, y, w, h = (round(side) for side in box_px)
    w, h = (max(min(side, size - at), 1) for side, size, at in ((w, image.shape[1], x), (h, image.shape[0], y)))
    try:
        return OpenCvTracker(cv2.TrackerNano.create(params), image, (x, y, w, h))
    except cv2.error as error:
        raise InputError(str(weights), f"expected NanoTrack's weights; OpenCV says: {error.err}") from error


def assumed_optics(width: int, height: int) -> Optics:
    """Optics of an unknown camera: a lens of about 30° without distortion.

    With a much longer lens the angles would be too small for single precision.
    """
    focal_px = 2.0 * max(width, height)
    return Optics(Camera(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2))


class ScoredTracker:
    """A tracker whose boxes are scored."""

    def __init__(self, tracker: BoxTracker, image: Image, box_px: BoxPx) -> None:
        self._tracker = tracker
        self._score = BoxScore(image, box_px)
        self._box_px = box_px

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        box_px = self._tracker.step(image)
        score = self._score.step(image, self._box_px if box_px is None else box_px)
        if box_px is None:
            return BoxDetection(self._box_px, 0.0)
        self._box_px = box_px
        return BoxDetection(box_px, score)


class BoxScore:
    """Probability that a box holds the object that it held in the first image, whichever tracker placed it.

    Logistic regression on two quantities that are compared within one image, so that they mean the same for any object
    and scene: how much better than its surroundings the box matches the object's colours, and how much better than any
    other place nearby its texture.
    """

    def __init__(self, image: Image, box_px: BoxPx) -> None:
        aspect = math.sqrt(box_px[2] / box_px[3])
        self._size = max(round(_SIDE_PX * aspect), 1), max(round(_SIDE_PX / aspect), 1)
        self._inside = masks.ellipse((0, 0, *self._size), (np.array(self._size) - 1) / 2, *self._size)
        self._template = _resampled(image, box_px, self._size)
        self._colors = _histogram(self._template[self._inside])

    def step(self, image: Image, box_px: BoxPx) -> float:
        """The score of a box in the next image; the object's colours and texture follow it where it is high."""
        if not (np.isfinite(box_px).all() and min(box_px[2:]) >= 1):
            return 0.0
        content = _resampled(image, box_px, self._size)
        colors = _histogram(content[self._inside])
        of_colors, of_texture, constant = _WEIGHTS
        logit = of_colors * self._color_contrast(image, box_px, colors) + constant
        logit += of_texture * self._texture_contrast(image, box_px)
        score = 1 / (1 + math.exp(-logit))
        if score > _LEARNED:
            self._template += RATE * (content - self._template)
            self._colors += RATE * (colors - self._colors)
        return score

    def _color_contrast(self, image: Image, box_px: BoxPx, colors: Array) -> float:
        """1 where the colours are the object's, 0 where they match it only as well as the surroundings."""
        w, h = self._size
        wide = _resampled(image, box_px, (int(_AROUND * w), int(_AROUND * h)), _AROUND)
        x, y = (wide.shape[1] - w) // 2, (wide.shape[0] - h) // 2
        around = np.ones(wide.shape[:2], bool)
        around[y - 2 : y + h + 2, x - 2 : x + w + 2] = False
        here, beside = (_similarity(seen, self._colors) for seen in (colors, _histogram(wide[around])))
        return _contrast(here, beside)

    def _texture_contrast(self, image: Image, box_px: BoxPx) -> float:
        """1 where the texture is the object's, 0 where it matches only as well as elsewhere in the region."""
        w, h = self._size
        region = _resampled(image, box_px, (_REGION * w, _REGION * h), _REGION)
        found = cv2.matchTemplate(region, self._template, cv2.TM_CCOEFF_NORMED)
        found = np.where(np.abs(found) <= 1.001, found, 0.0)  # a plain patch has no correlation
        y, x = (found.shape[0] - 1) // 2, (found.shape[1] - 1) // 2
        near_y, near_x = max(int(_TOLERANCE * h), 2), max(int(_TOLERANCE * w), 2)
        here = float(found[y - near_y : y + near_y + 1, x - near_x : x + near_x + 1].max())
        away_y, away_x = int(_ELSEWHERE * h), int(_ELSEWHERE * w)
        found[y - away_y : y + away_y + 1, x - away_x : x + away_x + 1] = -1
        return _contrast(here, float(found.max()))


def _contrast(here: float, elsewhere: float) -> float:
    return min(max((here - elsewhere) / (1 - elsewhere + _EPSILON), -1.0), 1.0)


def _resampled(image: Image, box_px: BoxPx, size: tuple[int, int], share: float = 1.0) -> NDArray[np.float32]:
    """The image (h, w, 3) of `size` (w, h) of what a box holds, grown to a share of its sides about its middle."""
    x, y, w, h = box_px
    center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
    scale = np.array([w * share / size[0], h * share / size[1]])
    side = max(1, int(scale.min()))  # pixels that are averaged
    reach = share * np.array([w, h])
    low = np.maximum(center - reach, 0).astype(int)
    high = (center + reach + 2).astype(int)
    part = image[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if part.size == 0:
        return np.zeros((size[1], size[0], 3), np.float32)
    part = np.asarray(cv2.blur(part, (side, side)), np.uint8)
    to_image = np.column_stack([np.diag(scale), center - low - scale * (np.array(size) - 1) / 2])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(part, to_image, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32)


def _histogram(pixels: Array | NDArray[np.float32]) -> Array:
    """(512,) normalised histogram of colours (n, 3), eight levels a channel."""
    levels = pixels.astype(int) >> 5
    counts = np.bincount(levels @ (64, 8, 1), minlength=512).astype(float)
    return counts / max(counts.sum(), 1.0)


def _similarity(a: Array, b: Array) -> float:
    """Bhattacharyya coefficient of two histograms."""
    return float(np.sqrt(a * b).sum())


def _check(image: Image, box_px: BoxPx) -> None:
    """Raise InputError for a box that does not lie in the image, or is smaller than 2×2 pixels."""
    height, width = image.shape[:2]
    x, y, w, h = box_px
    if not (w >= 2 and h >= 2 and x >= 0 and y >= 0 and x + w <= width and y + h <= height):
        raise InputError(
            "image tracker", f"first box {x:g} {y:g} {w:g} {h:g}: expected a box inside the {width}×{height} image"
        )
