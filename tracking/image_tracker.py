"""Image tracker of one camera: colour likelihood → particle filter → mask → sub-pixel outline (R Fig 13)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, Image, Mask
from tracking import masks
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.ego_motion import Box
from tracking.outline import Optics, Outline, fit_outline
from tracking.particle_filter import Particles, Prior, likelihoods, propagate, resample, sample

Evidence = Callable[[Box], NDArray[np.float32] | Mask]
"""(h, w) probability that each pixel of a box is not the background, or whether it differs from it."""
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
_GAP = 0.05  # of the object's size: gaps up to twice as wide are closed in what differs from the background
_THIN = 0.22  # of the object's size: radius of the disc that opens its mask
MIN_SCORE = 0.4  # below which the object counts as not seen
_LEARN_RATE = 0.03  # at which the colours of the object follow the image
_BACKGROUND_RATE = 0.2  # at which those of its surroundings do
_SIZE_RATE = 0.3  # the same for its size and proportions
_MIN_AREA_PX = 10  # smallest image of an object
# Share of a mask left without its thin parts, below which they are the object's own (octopus 0.6, leaks 0.9).
_CORE = 0.75
_REACH = 1.25  # largest mask, as a multiple of the expected size
# Chosen on independent films of two equal balls and of fast reversals, seeds 4107 and 4129-4141.
_TOUCHING = 0.25  # of the object's area, what is joined with it beyond its reach if another thing touches it
_PASSING = 5  # images for which the two may hide each other then
_BESIDE = 0.05  # of its size, by which it may then be off the prediction beside its standard deviation


@dataclass(frozen=True)
class ImageTrackerParams:
    """Parameters of the image tracker."""

    particles: int = 120
    """Number of particles."""

    def __post_init__(self) -> None:
        if self.particles < 2:
            raise ValueError(f"{self.particles} particles; expected at least 2")


class ImageDetection(NamedTuple):
    """The object in one image: its outline, its box with the size smoothed over time, and how well colours and area
    fit, 0–1."""

    outline: Outline
    box_px: BoxPx
    score: float


@dataclass(frozen=True, slots=True)
class Target:
    """State of the image tracker: colours, particles, √(width·height) of the box in px, the box's sides at unit size,
    the share of the box that the object covers, and for how many more images another thing may touch it."""

    model: ColorModel
    particles: Particles
    size: float
    shape: tuple[float, float]
    fill: float
    touched: int = 0


class ImageTracker:
    """Follows one object in one camera's images.  Holds no state: `start` gives a `Target`, `step` the next one."""

    def __init__(self, params: ImageTrackerParams, optics: Optics, rng: np.random.Generator) -> None:
        self.params, self.optics, self.rng = params, optics, rng

    def start(
        self,
        image: Image,
        box: BoxPx,
        model: ColorModel | None = None,
        shift_px: Array | None = None,
        fill: float | None = None,
    ) -> Target:
        """The target that fills a box, its colours taken from the image or from another `model`.

        `shift_px` (2,) is its motion from one image to the next (None: at rest); `fill` the share of the box that it
        covers (None: as its colours show).
        """
        x, y, w, h = box
        center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        roi = self.region(center, 1.2 * w + 4, 1.2 * h + 4)
        bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
        inside, around = masks.ellipse(roi, center, 0.9 * w, 0.9 * h), masks.ellipse(roi, center, 1.2 * w, 1.2 * h)
        model = model or ColorModel(histogram(bins[inside]), histogram(bins[~around]))
        size, aspect = float(np.sqrt(w * h)), float(np.sqrt(w / h))
        shape = (aspect, 1 / aspect)
        if fill is None:
            found = self._mask(model.table()[bins], model.backdrop()[bins], roi, center, size, shape)
            whole = None if found is None else fit_outline(image, found[0], roi, self.optics)
            fill = np.pi / 4 if whole is None else min(whole.area_px / (w * h), 1.0)  # in the measure `step` uses
        particles = sample(self.params.particles, center, size, 0.5, self.rng, shift_px)
        return Target(model, particles, size, shape, fill)

    def step(
        self,
        target: Target,
        image: Image,
        prior: Prior | None = None,
        evidence: Evidence | None = None,
        by_color: bool = True,
        if_joined: Evidence | None = None,
    ) -> tuple[Target, ImageDetection | None]:
        """The target in the next image, and its detection; None where it does not show.

        Args:
            target: In the last image.
            image: RGB (H, W, 3).
            prior: Where the object is predicted; None where it was last.
            evidence: Says what is not the background: the object is nowhere else.  None: the background is unknown.
            by_color: Whether the object's colours are its likelihood; else the evidence is.
            if_joined: The evidence to use, where there is none, if colours join the object with something else.
        """
        s = replace(target, touched=max(target.touched - 1, 0))

        def likelihood_in(roi: Box) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
            bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
            if evidence is None:
                return bins, np.take(s.model.table(), bins)
            changed = evidence(roi)
            if not by_color:
                return bins, np.asarray(changed, np.float32)
            colors = np.take(s.model.table(), bins)
            return bins, np.asarray(cv2.copyTo(colors, np.asarray(changed > 0.5).view(np.uint8)), np.float32)

        if prior:
            s = replace(s, size=s.size * prior.growth)
        particles = propagate(s.particles, prior, self.rng)
        middle, reach = particles.current[:, :2].mean(axis=0), 2.0 * particles.current[:, :2].std(axis=0)
        half = _REACH * s.size * np.array(s.shape) / 2 + reach + 4
        roi = self.region(middle, *half)
        if roi[2] - roi[0] < 4 or roi[3] - roi[1] < 4:
            return s, None
        bins, likelihood = likelihood_in(roi)
        weights = likelihoods(particles, _integral(2 * likelihood - 1), roi[:2], s.shape)
        center: Array = weights @ particles.current[:, :2]
        s = replace(s, particles=resample(particles, weights, self.rng))
        backdrop = s.model.backdrop()[bins] if evidence is None else None
        seen = self._mask(likelihood, backdrop, roi, center, s.size, s.shape, s.fill)
        if seen is not None and evidence is not None and masks.is_cut(seen[0], roi, image):
            center = masks.centroid(seen[0], roi)
            roi = self.region(center, *half)
            bins, likelihood = likelihood_in(roi)
            seen = self._mask(likelihood, None, roi, center, s.size, s.shape, s.fill)
        if seen is None:
            return s, None
        mask, both = seen
        if evidence is None and both is not None and if_joined is not None:
            return self.step(target, image, prior, if_joined, by_color)
        if evidence is None:
            both = None
        if both is not None:
            s = replace(s, touched=_PASSING)
        expected_area = s.fill * s.size**2
        outline = fit_outline(image, mask, roi, self.optics, expected_area, both)
        if outline is None or (s.touched and prior is not None and _is_off(outline, prior, s.size)):
            return s, None
        ratio = outline.area_px / expected_area
        score = s.model.similarity(histogram(bins[mask])) if by_color else float(likelihood[mask].mean())
        score *= min(ratio, 1 / ratio)
        if score < MIN_SCORE:
            return s, None
        return self._learn(s, bins, mask, outline, score, ratio)

    def follow(self, target: Target, outline: Outline) -> Target:
        """The target moved to an outline that was found without it; its colours stay."""
        size = float(np.sqrt(outline.area_px / target.fill))
        return replace(target, particles=_moved_to(target.particles, outline.center_px, size), size=size)

    def _learn(
        self, s: Target, bins: NDArray[np.uint8], mask: Mask, outline: Outline, score: float, ratio: float
    ) -> tuple[Target, ImageDetection]:
        """Particles, size and colours follow what was seen; the size only where the whole object was."""
        k = _SIZE_RATE
        size = s.size if outline.is_partial else s.size * ratio ** (0.5 * k)
        seen_aspect = s.shape[0] ** 2 if outline.is_partial else outline.box_px[2] / outline.box_px[3]
        aspect = (s.shape[0] ** 2) ** (1 - k) * seen_aspect**k
        newest = ColorModel(histogram(bins[mask]), histogram(bins[~masks.dilated(mask, 2)]))
        model = s.model.blend(newest, _LEARN_RATE, _BACKGROUND_RATE)
        sides = (float(np.sqrt(aspect)), float(1 / np.sqrt(aspect)))
        target = Target(model, _moved_to(s.particles, outline.center_px, size), size, sides, s.fill, s.touched)
        w, h = size * sides[0], size * sides[1]
        x, y = outline.center_px.tolist()
        return target, ImageDetection(outline, (x - (w - 1) / 2, y - (h - 1) / 2, w, h), score)

    def region(self, center: Array, half_w: float, half_h: float) -> Box:
        """The part of the image that reaches so far (px) to all sides of a centre (2,)."""
        camera = self.optics.camera
        x0, y0 = max(int(center[0] - half_w), 0), max(int(center[1] - half_h), 0)
        return x0, y0, min(int(center[0] + half_w) + 2, camera.width), min(int(center[1] + half_h) + 2, camera.height)

    def _mask(
        self,
        likelihood: NDArray[np.float32],
        backdrop: Mask | None,
        roi: Box,
        center: Array,
        size: float,
        shape: tuple[float, float],
        fill: float = 1.0,
    ) -> tuple[Mask, Mask | None] | None:
        """The object's pixels near `center`, holes filled, and all that they are joined with, where that is so large
        that another thing touches the object; None where there are too few.

        What reaches past the expected outline is cut off there, and what is much thinner than the object is opened
        away (a part of the background that has the object's colour and touches it), unless that is much of the mask.
        Without a `backdrop` (a mask of what differs from a known background) wider gaps are closed: there the object
        looks like what is behind it.
        """
        hard: Mask = np.asarray(cv2.GaussianBlur(likelihood, (3, 3), 0)) > 0.5
        if size >= 12:
            gap = 1 if backdrop is not None else max(int(_GAP * size), 1)
            hard = masks.closed(hard, masks.square(gap))
        w, h = size * shape[0], size * shape[1]
        one, both = hard, None
        for k in range(2):
            found = masks.component(hard, masks.ellipse(roi, center, 0.6 * w, 0.6 * h))
            if found is None:
                return None
            one = found
            allowed = masks.ellipse(roi, center, _REACH * w, _REACH * h)
            beyond = np.count_nonzero(one & ~allowed)
            if not beyond:
                break
            if k == 0 and beyond > _TOUCHING * fill * size**2:
                both = masks.filled(found, backdrop)
            one = _without_thin_parts(one & allowed, size)
            center = masks.centroid(one, roi)
        whole = masks.filled(one, backdrop)
        return (whole, both) if np.count_nonzero(whole) >= _MIN_AREA_PX else None


def _is_off(outline: Outline, prior: Prior, size: float) -> bool:
    """Whether an outline is another object's than the predicted one, of which both touch."""
    off_px = math.dist(outline.center_px.tolist(), prior.center_px.tolist())
    return off_px > 3 * prior.std_px + _BESIDE * size


def _without_thin_parts(mask: Mask, size: float) -> Mask:
    """Without what is less than half as wide as the object; the mask itself where that leaves little."""
    if size <= 12:
        return mask
    core = masks.opened(mask, int(_THIN * size))
    return core if np.count_nonzero(core) > _CORE * np.count_nonzero(mask) else mask


def _moved_to(particles: Particles, center_px: Array, size: float) -> Particles:
    """The particles about another centre (2,), with another mean size."""
    now = particles.current.copy()
    now[:, :2] += center_px - now[:, :2].mean(axis=0)
    now[:, 2] *= size / now[:, 2].mean()
    return Particles(now, particles.previous)


def _integral(values: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.asarray(cv2.integral(values, sdepth=cv2.CV_64F), dtype=np.float64)
