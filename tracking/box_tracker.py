"""Follows an object in the images of one uncalibrated camera, given its box in the first.

A particle filter as that of `image_tracker`: its likelihood is the colour histogram's, or the sum of that and of a
spatial template's response (Bertinetto et al., CVPR 2016).  The score says how likely the box holds the object.
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.types import Array, Image, Mask
from tracking import template as spatial
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.image_tracker import BoxPx, ImageTracker, ImageTrackerParams, Target
from tracking.outline import Optics
from tracking.particle_filter import Cloud, Prior, propagate, resample, spawn
from tracking.template import CELL, CELLS, PADDING, Map, Sample, Shape, Template

Appearance = Literal["colour", "template"]
"""What tells the object from its surroundings: its colours alone, or a spatial template and its colours."""
ALIKE = 0.7
"""Bhattacharyya coefficient of the colours of an object and its surroundings from which they are alike: colours alone
lost every film above it (bench imagetracker)."""
_COLOR_SHARE = 0.3  # of the likelihood, as in Bertinetto et al.
_SHARPNESS = 30.0  # of the particles' log-likelihood; a response and a colour gain are at most about 1
_NEAR = 0.125  # log-likelihood lost at a distance of one size from the last place, squared
_STD = 0.05  # of the object's size: the particles' spread around the best cell, which is 0.1 wide
_OBJECT_RATE, _SURROUNDINGS_RATE = 0.03, 0.1  # at which colours follow the newest image
_MEMORY_RATE, _MEMORY_SCORE = 0.005, 0.9  # at which the memory follows, and the least score of what it takes in
LEAST_SCORE = 0.5
"""Score from which the object is learned from."""
_FOUND_SCORE = 0.9  # from which a lost object is found again
LOST_SCORE = 0.4
"""Score below which the object counts as not seen, and its last box stays."""
# Colours alone do where they are at most so similar to the surroundings', and where what has them has a box that
# overlaps the first one by so much (composite films).
_SEPARATE, _GIVEN_BACK = 0.25, 0.85
_WIDEN = 0.15  # of the object's size a frame: by so much more around its last place a lost object is searched
_SMALLEST_PX, _LARGEST = 6.0, 0.9  # size of an object, px, and share of the image's shorter side


@dataclass(frozen=True, slots=True)
class BoxDetection:
    """Where the object is (x, y, width, height px), and the probability that it is there, 0–1."""

    box_px: BoxPx
    score: float


@dataclass(frozen=True, slots=True)
class _State:
    """The object: template and colours, and a slower memory of it; particles; size √(width·height), px; frames since it
    was seen."""

    template: Template
    model: ColorModel
    memory: "_Memory"
    cloud: Cloud
    size: float
    lost: int = 0

    @property
    def center(self) -> Array:
        """(2,) px."""
        mean: Array = self.cloud.now[:, :2].mean(axis=0)
        return mean


@dataclass(frozen=True, slots=True)
class _Memory:
    """What the object looked like over the last seconds: template, orientations of its cells (9, m), histogram of
    its colours.  It shows whether what is followed is still the object."""

    template: Template
    cells: NDArray[np.float32]
    colors: Array

    def blend(self, template: Template, cells: NDArray[np.float32], colors: Array) -> "_Memory":
        """This memory moved towards the present appearance."""
        k = np.float32(_MEMORY_RATE)
        places = (1 - k) * self.template.places + k * template.places
        return _Memory(
            replace(template, places=places), (1 - k) * self.cells + k * cells, (1 - k) * self.colors + k * colors
        )


class TemplateTracker:
    """Particle filter whose likelihood is that of colours and of a spatial template."""

    def __init__(self, params: ImageTrackerParams, image: Image, box: BoxPx, rng: np.random.Generator) -> None:
        self._rng = rng
        x, y, w, h = box
        center, size = np.array([x + (w - 1) / 2, y + (h - 1) / 2]), float(np.sqrt(w * h))
        self._shape: Shape = (w / size, h / size)
        self._inside, self._around, self._object = _regions(self._shape)
        seen = spatial.sample(image, center, size)
        colors, around = self._colors(seen)
        template = spatial.learn(image, center, size, self._shape)
        cloud = spawn(params.particles, center, size, 0.0, rng)
        memory = _Memory(template, self._orientations(seen), colors)
        self._state = _State(template, ColorModel(colors, around), memory, cloud, size)
        self.similarity = float(np.sqrt(colors * around).sum())

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        s = self._state
        moved = self._moved(s, image, self._place(s, image))
        moved = replace(moved, size=self._grown(moved, image))
        seen = spatial.sample(image, moved.center, moved.size)
        colors, around = self._colors(seen)
        score = confidence(self._traits(s, seen, colors, around))
        if score < (_FOUND_SCORE if s.lost > 0 else LOST_SCORE):
            self._state = replace(s, lost=s.lost + 1)
            return BoxDetection(self._box(s), min(score, 0.5 * LOST_SCORE))
        if score >= LEAST_SCORE:
            template = spatial.learn_places(moved.template, seen)
            template = spatial.learn_scales(template, image, moved.center, moved.size, self._shape)
            model = s.model.blend(ColorModel(colors, around), _OBJECT_RATE, _SURROUNDINGS_RATE)
            memory = s.memory
            if score >= _MEMORY_SCORE:
                memory = memory.blend(template, self._orientations(seen), colors)
            moved = replace(moved, template=template, model=model, memory=memory)
        self._state = replace(moved, lost=0)
        return BoxDetection(self._box(moved), score)

    def judge(self, image: Image, box: BoxPx) -> float:
        """The probability that a box that was found otherwise holds the object; where it is likely, the tracker follows
        there."""
        s, (x, y, w, h) = self._state, box
        center, size = np.array([x + (w - 1) / 2, y + (h - 1) / 2]), float(np.sqrt(w * h))
        seen = spatial.sample(image, center, size)
        colors, around = self._colors(seen)
        score = confidence(self._traits(s, seen, colors, around))
        if score >= LEAST_SCORE:
            memory = s.memory.blend(s.template, self._orientations(seen), colors)
            cloud = spawn(len(s.cloud.now), center, size, 0.0, self._rng)
            self._state = replace(s, memory=memory, cloud=cloud, size=size, lost=0)
        return score

    def _place(self, s: _State, image: Image) -> Array:
        """(2,) px around which to search: the last place, or, every other frame while the object is lost, any."""
        if s.lost % 2 == 0:
            return s.center
        height, width = image.shape[:2]
        away = s.center + (1 + _WIDEN * s.lost) * s.size * self._rng.standard_normal(2)
        return np.clip(away, 0, [width - 1, height - 1])

    def _moved(self, s: _State, image: Image, place: Array) -> _State:
        """Particles gather where the likelihood is largest."""
        seen = spatial.sample(image, place, s.size)
        fit = spatial.response(s.template, seen) + _COLOR_SHARE * self._gain(s.model, seen)
        offset = spatial.cell_offsets() + 0.5 * PADDING / CELLS  # a shift by k − n/2 cells
        near = _NEAR * (offset[:, None] ** 2 + offset**2) if s.lost == 0 else np.zeros_like(fit)
        row, column = divmod(int(np.argmax(fit - near)), CELLS)
        at = np.array([column + spatial.peak_offset(fit[row], column), row + spatial.peak_offset(fit[:, column], row)])
        cell_px = PADDING * s.size / CELLS
        best = place + (at - CELLS // 2) * cell_px
        cloud = propagate(s.cloud, Prior(best, _STD * s.size, 1.0), self._rng)
        u, v = ((cloud.now[:, :2] - place) / cell_px + CELLS // 2).astype(np.float32).T
        log = _SHARPNESS * np.asarray(cv2.remap(fit, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)).ravel()
        weights = np.exp(log - log.max())
        cloud = resample(cloud, weights / weights.sum(), self._rng)
        height, width = image.shape[:2]
        inside = np.clip(cloud.now[:, :2], 0, [width - 1, height - 1])
        return replace(s, cloud=Cloud(np.column_stack([inside, cloud.now[:, 2]]), cloud.before))

    def _gain(self, model: ColorModel, seen: Sample) -> Map:
        """(n, n) mean of 2p − 1 in the object's box at each shift, p the probability of its colours."""
        gain = (2 * model.table() - 1)[color_bins(seen.patch)]
        sides = [int(side * CELLS * CELL / PADDING) | 1 for side in self._shape]
        mean = cv2.boxFilter(gain, cv2.CV_32F, (sides[0], sides[1]), borderType=cv2.BORDER_REPLICATE)
        at = np.maximum(np.arange(CELLS) * CELL - 1, 0)
        return np.asarray(mean, dtype=np.float32)[np.ix_(at, at)]

    def _grown(self, s: _State, image: Image) -> float:
        size = s.size * spatial.growth(s.template, image, s.center, s.size, self._shape)
        return float(np.clip(size, _SMALLEST_PX, max(_LARGEST * min(image.shape[:2]), _SMALLEST_PX)))

    def _colors(self, seen: Sample) -> tuple[Array, Array]:
        """Histograms of the object and of its surroundings."""
        bins = color_bins(seen.patch)
        return histogram(bins[self._inside]), histogram(bins[self._around])

    def _traits(self, s: _State, seen: Sample, colors: Array, around: Array) -> Array:
        """(4,) what tells whether the object is in the middle of a sample.

        Similarity of its colours to those remembered, and to its surroundings; logarithm of the peak of the remembered
        template's response, in standard deviations; correlation of its gradients with those remembered.
        """
        fit = spatial.response(s.memory.template, seen)
        middle = float(fit[CELLS // 2 - 2 : CELLS // 2 + 3, CELLS // 2 - 2 : CELLS // 2 + 3].max())
        now, then = self._orientations(seen), s.memory.cells
        alike = float((now * then).sum() / np.sqrt((now * now).sum() * (then * then).sum() + 1e-9))
        peak = float(np.log(max(middle / max(float(fit.std()), 1e-9), 1.0)))
        return np.array(
            [float(np.sqrt(s.memory.colors * colors).sum()), float(np.sqrt(colors * around).sum()), peak, alike]
        )

    def _orientations(self, seen: Sample) -> NDArray[np.float32]:
        """(9, m) orientations of the object's m cells, each without its mean."""
        cells = seen.cells[: spatial.N_ORIENTATIONS, self._object]
        return cells - cells.mean(axis=1, keepdims=True)

    def _box(self, s: _State) -> BoxPx:
        (x, y), w, h = s.center.tolist(), s.size * self._shape[0], s.size * self._shape[1]
        return x - (w - 1) / 2, y - (h - 1) / 2, w, h


# Logistic regression on composite films (`bench imagetracker`); of `_traits`.
_WEIGHTS, _BIAS = np.array([8.39, -10.68, 7.39, 8.56]), -15.24


def confidence(traits: Array) -> float:
    """Probability that the box holds the object."""
    return float(1 / (1 + np.exp(-np.clip(traits @ _WEIGHTS + _BIAS, -30, 30))))


def _regions(shape: Shape) -> tuple[Mask, Mask, Mask]:
    """Pixels of a patch inside the object, and around it; and its cells (n, n)."""
    n = CELLS * CELL
    at = (np.arange(n) - (n - 1) / 2) * PADDING / n

    def box(offsets: Array, share: float, margin: float = 0.0) -> Mask:
        w, h = (0.5 * share * side + margin for side in shape)
        mask: Mask = (np.abs(offsets)[:, None] < h) & (np.abs(offsets) < w)
        return mask

    around = box(at, 1.0, 0.5) & ~box(at, 1.1)
    return box(at, 0.8), around, box(spatial.cell_offsets(), 1.1)


class BoxTracker:
    """Follows one object in the images of an uncalibrated camera: `start` with the first image and box, then `step`
    per image.

    `appearance` is what the object is followed by; None: its colours where they tell it apart, which is the cheapest,
    else the template.  `similarity` (after `start`) is that of the object's colours to its surroundings', 0–1.
    """

    def __init__(
        self, params: ImageTrackerParams, rng: np.random.Generator, appearance: Appearance | None = None
    ) -> None:
        self.params, self.rng, self.appearance, self.similarity = params, rng, appearance, 0.0
        self._template: TemplateTracker | None = None
        self._by_color: tuple[ImageTracker, Target] | None = None

    def start(self, image: Image, box_px: BoxPx) -> BoxDetection:
        """Learn the object in `box_px` of the first RGB image; InputError where the box is no part of it."""
        height, width = image.shape[:2]
        x, y, w, h = box_px
        if not (w >= 2 and h >= 2 and x >= 0 and y >= 0 and x + w <= width and y + h <= height):
            raise InputError(
                "image tracker", f"first box {x:g} {y:g} {w:g} {h:g}: expected a box inside the {width}×{height} image"
            )
        self._template = TemplateTracker(self.params, image, box_px, self.rng)
        self.similarity = self._template.similarity
        tracker = ImageTracker(self.params, assumed_optics(width, height), self.rng)
        target = tracker.start(image, box_px)
        if self.appearance is None:
            self.appearance = "colour" if _gives_back(tracker, target, image, box_px) else "template"
        self._by_color = (tracker, target) if self.appearance == "colour" else None
        return BoxDetection(box_px, 1.0)

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image; where its colours do not show it, the template searches it."""
        if self._template is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        if self._by_color is None:
            return self._template.step(image)
        tracker, target = self._by_color
        moved, seen = tracker.step(target, image)
        if seen is not None:
            score = self._template.judge(image, seen.box_px)
            if score >= LEAST_SCORE:
                self._by_color = tracker, moved
                return BoxDetection(seen.box_px, score)
        found = self._template.step(image)
        if found.score >= LEAST_SCORE:
            self._by_color = tracker, tracker.start(image, found.box_px, target.model, fill=target.fill)
        return found


def _gives_back(tracker: ImageTracker, target: Target, image: Image, box: BoxPx) -> bool:
    """Whether colours that are not those of the surroundings show the object's box in the image they are from."""
    _, seen = tracker.step(target, image)
    if seen is None or target.model.similarity(target.model.background) > _SEPARATE:
        return False
    low, high = np.maximum(seen.box_px[:2], box[:2]), np.minimum(_end(seen.box_px), _end(box))
    shared = float(np.prod(np.maximum(high - low, 0)))
    return shared > _GIVEN_BACK * (np.prod(seen.box_px[2:]) + np.prod(box[2:]) - shared)


def _end(box: BoxPx) -> Array:
    return np.array([box[0] + box[2], box[1] + box[3]])


def assumed_optics(width: int, height: int) -> Optics:
    """For an unknown camera: a lens of about 30° without distortion.  (With a much longer one the angles would be too
    small for single precision.)"""
    focal = 2.0 * max(width, height)
    return Optics(Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2))
