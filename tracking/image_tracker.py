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
from tracking.particle_filter import SHARPNESS, Particles, Prior, likelihoods, propagate, resample, sample

Evidence = Callable[[Box], NDArray[np.float32] | Mask]
"""Box → probability (h, w) that a pixel is foreground, or a foreground mask."""
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
_WIDE_PRIOR = 0.5  # standard deviation, in object sizes, above which too few particles would fall on the object
_GAP = 0.05  # half the width, in object sizes, of gaps that are closed in a foreground mask
_THIN = 0.22  # radius, in object sizes, of the disc that opens its mask
MIN_SCORE = 0.4  # below which the object is not detected
_LEARN_RATE = 0.03  # update rate of the object's colours
_BACKGROUND_RATE = 0.2  # the same for the colours around it
_SIZE_RATE = 0.3  # the same for its size and aspect ratio
_MIN_AREA_PX = 10  # area of the smallest object
# Share of a mask without its thin parts below which these belong to the object (octopus 0.6, leaks 0.9).
_CORE = 0.75
_REACH = 1.25  # largest mask, as a multiple of the expected size
# Chosen on independent films of two equal balls and of fast reversals, seeds 4107 and 4129-4141.
_TOUCHING = 0.25  # area beyond the reach, relative to the object's, from which another object touches it
_PASSING = 5  # images for which the two may occlude each other
_BESIDE = 0.05  # tolerance of the prediction then, in object sizes, added to three standard deviations


@dataclass(frozen=True)
class ImageTrackerParams:
    """Parameters of the image tracker."""

    particles: int = 120
    """Number of particles."""

    def __post_init__(self) -> None:
        if self.particles < 2:
            raise ValueError(f"{self.particles} particles; expected at least 2")


class ImageDetection(NamedTuple):
    """Detection in one image: outline, box (size smoothed over time), and similarity of colours and area, 0–1."""

    outline: Outline
    box_px: BoxPx
    score: float


@dataclass(frozen=True, slots=True)
class Target:
    """State of the image tracker: colours, particles, size √(width·height) of the box (px), sides of the box at unit
    size, share of the box that the object covers, and number of further images in which another object may touch it."""

    model: ColorModel
    particles: Particles
    size: float
    shape: tuple[float, float]
    fill: float
    touched: int = 0


class ImageTracker:
    """Tracks one object in one camera's images. Holds no state: `start` returns a `Target`, `step` the next one."""

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
        """Initial target.

        Args:
            image: RGB (H, W, 3).
            box: Box of the object.
            model: Its colours; None: from the image.
            shift_px: Its motion (2,) from one image to the next; None: at rest.
            fill: Share of the box that it covers; None: from its colours.
        """
        x, y, w, h = box
        center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        roi = self.region(center, 1.2 * w + 4, 1.2 * h + 4)
        bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
        inside = masks.ellipse(roi, center, 0.9 * w, 0.9 * h)
        around = masks.ellipse(roi, center, 1.2 * w, 1.2 * h)
        model = model or ColorModel(histogram(bins[inside]), histogram(bins[~around]))
        size = float(np.sqrt(w * h))
        aspect = float(np.sqrt(w / h))
        shape = (aspect, 1 / aspect)
        if fill is None:
            segments = self._mask(model.table()[bins], model.backdrop()[bins], roi, center, size, shape)
            outline = None if segments is None else fit_outline(image, segments[0], roi, self.optics)
            fill = np.pi / 4 if outline is None else min(outline.area_px / (w * h), 1.0)  # as measured by `step`
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
        """The target in the next image, and its detection; None where it is not detected.

        Args:
            target: In the last image.
            image: RGB (H, W, 3).
            prior: Predicted position; None: constant velocity.
            evidence: Foreground, which contains the object; None: the background is unknown.
            by_color: Whether the likelihood is that of the object's colours; else it is the evidence.
            if_joined: Evidence to use, if `evidence` is None, where another object has the colours and touches.
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
            if prior.std_px > _WIDE_PRIOR * s.size:
                prior = self._narrowed(s, prior, likelihood_in)
        particles = propagate(s.particles, prior, self.rng)
        middle = particles.current[:, :2].mean(axis=0)
        reach = 2.0 * particles.current[:, :2].std(axis=0)
        half = _REACH * s.size * np.array(s.shape) / 2 + reach + 4
        roi = self.region(middle, *half)
        if roi[2] - roi[0] < 4 or roi[3] - roi[1] < 4:
            return s, None
        bins, likelihood = likelihood_in(roi)
        weights = likelihoods(particles, _integral(2 * likelihood - 1), roi[:2], s.shape)
        center: Array = weights @ particles.current[:, :2]
        s = replace(s, particles=resample(particles, weights, self.rng))
        backdrop = s.model.backdrop()[bins] if evidence is None else None
        segments = self._mask(likelihood, backdrop, roi, center, s.size, s.shape, s.fill)
        if segments is not None and evidence is not None and masks.is_cut(segments[0], roi, image):
            center = masks.centroid(segments[0], roi)
            roi = self.region(center, *half)
            bins, likelihood = likelihood_in(roi)
            segments = self._mask(likelihood, None, roi, center, s.size, s.shape, s.fill)
        if segments is None:
            return s, None
        mask, joined = segments
        if evidence is None and joined is not None and if_joined is not None:
            return self.step(target, image, prior, if_joined, by_color)
        if evidence is None:
            joined = None
        if joined is not None:
            s = replace(s, touched=_PASSING)
        expected_area = s.fill * s.size**2
        outline = fit_outline(image, mask, roi, self.optics, expected_area, joined)
        if outline is None or (s.touched and prior is not None and _is_off(outline, prior, s.size)):
            return s, None
        ratio = outline.area_px / expected_area
        score = s.model.similarity(histogram(bins[mask])) if by_color else float(likelihood[mask].mean())
        score *= min(ratio, 1 / ratio)
        if score < MIN_SCORE:
            return s, None
        return self._learn(s, bins, mask, outline, score, ratio)

    def follow(self, target: Target, outline: Outline) -> Target:
        """The target moved to an outline that was detected otherwise; its colours stay."""
        size = float(np.sqrt(outline.area_px / target.fill))
        return replace(target, particles=_moved_to(target.particles, outline.center_px, size), size=size)

    def _narrowed(
        self, s: Target, prior: Prior, likelihood_in: Callable[[Box], tuple[NDArray[np.uint8], NDArray[np.float32]]]
    ) -> Prior:
        """Narrow a wide prior to its most object-like position (maximum of centre-surround likelihood)."""
        w, h = (s.size * side for side in s.shape)
        roi = self.region(prior.center_px, 2 * prior.std_px + w, 2 * prior.std_px + h)
        if roi[2] <= roi[0] or roi[3] <= roi[1]:
            return prior
        likelihood = likelihood_in(roi)[1]
        inside, surround = (_box_mean(likelihood, k * w, k * h) for k in (1, 2))
        x = np.arange(roi[0], roi[2]) - prior.center_px[0]
        y = np.arange(roi[1], roi[3]) - prior.center_px[1]
        distance2 = x[None, :] ** 2 + y[:, None] ** 2
        log = SHARPNESS * 4 / 3 * (inside - surround) - distance2 / (2 * prior.std_px**2)
        row, column = np.unravel_index(int(np.argmax(log)), log.shape)
        return Prior(np.array([roi[0] + column, roi[1] + row]), 0.25 * s.size, prior.growth)

    def _learn(
        self, s: Target, bins: NDArray[np.uint8], mask: Mask, outline: Outline, score: float, ratio: float
    ) -> tuple[Target, ImageDetection]:
        """Update particles, size and colours from a detection; the size only if the whole object is visible."""
        k = _SIZE_RATE
        size = s.size if outline.is_partial else s.size * ratio ** (0.5 * k)
        measured_aspect = s.shape[0] ** 2 if outline.is_partial else outline.box_px[2] / outline.box_px[3]
        aspect = (s.shape[0] ** 2) ** (1 - k) * measured_aspect**k
        newest = ColorModel(histogram(bins[mask]), histogram(bins[~masks.dilated(mask, 2)]))
        model = s.model.blend(newest, _LEARN_RATE, _BACKGROUND_RATE)
        sides = (float(np.sqrt(aspect)), float(1 / np.sqrt(aspect)))
        target = Target(model, _moved_to(s.particles, outline.center_px, size), size, sides, s.fill, s.touched)
        w, h = size * sides[0], size * sides[1]
        x, y = outline.center_px.tolist()
        return target, ImageDetection(outline, (x - (w - 1) / 2, y - (h - 1) / 2, w, h), score)

    def region(self, center: Array, half_w: float, half_h: float) -> Box:
        """Region of the image up to `half_w` and `half_h` (px) from a centre (2,)."""
        camera = self.optics.camera
        x, y = center
        box = (int(x - half_w), int(y - half_h), int(x + half_w) + 2, int(y + half_h) + 2)
        return masks.clipped(box, camera.width, camera.height)

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
        """Mask of the object near `center`, and the whole component if another object touches it, else None; None if
        the mask is too small.

        The mask is cut off beyond the expected outline, and parts that are much thinner than the object are removed by
        opening (background of the object's colour that touches it), unless they are much of the mask. Holes are filled.
        Without a `backdrop` (the likelihood is a foreground mask) wider gaps are closed, where object and background
        have the same colour.
        """
        hard: Mask = np.asarray(cv2.GaussianBlur(likelihood, (3, 3), 0)) > 0.5
        if size >= 12:
            gap = 1 if backdrop is not None else max(int(_GAP * size), 1)
            hard = masks.closed(hard, masks.square(gap))
        w, h = size * shape[0], size * shape[1]
        component = masks.component(hard, masks.ellipse(roi, center, 0.6 * w, 0.6 * h))
        if component is None:
            return None
        joined = None
        within = component & masks.ellipse(roi, center, _REACH * w, _REACH * h)
        if beyond := np.count_nonzero(component) - np.count_nonzero(within):
            if beyond > _TOUCHING * fill * size**2:
                joined = masks.filled(component, backdrop)
            component = _without_thin_parts(within, size)
        mask = masks.filled(component, backdrop)
        return (mask, joined) if np.count_nonzero(mask) >= _MIN_AREA_PX else None


def _is_off(outline: Outline, prior: Prior, size: float) -> bool:
    """Whether an outline belongs to the other of two touching objects."""
    off_px = math.dist(outline.center_px.tolist(), prior.center_px.tolist())
    return off_px > 3 * prior.std_px + _BESIDE * size


def _without_thin_parts(mask: Mask, size: float) -> Mask:
    """The mask without parts less than half as wide as the object; the mask itself where that leaves little."""
    if size <= 12:
        return mask
    core = masks.opened(mask, int(_THIN * size))
    return core if np.count_nonzero(core) > _CORE * np.count_nonzero(mask) else mask


def _moved_to(particles: Particles, center_px: Array, size: float) -> Particles:
    """The particles moved to a mean position (2,) and a mean size."""
    current = particles.current.copy()
    current[:, :2] += center_px - current[:, :2].mean(axis=0)
    current[:, 2] *= size / current[:, 2].mean()
    return Particles(current, particles.previous)


def _box_mean(values: NDArray[np.float32], width: float, height: float) -> NDArray[np.float32]:
    """Means over a box of odd sides around every pixel; 0 outside of the values."""
    sides = (2 * int(width / 2) + 1, 2 * int(height / 2) + 1)
    return np.asarray(cv2.boxFilter(values, cv2.CV_32F, sides, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def _integral(values: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.asarray(cv2.integral(values, sdepth=cv2.CV_64F), dtype=np.float64)
