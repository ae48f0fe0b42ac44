"""One eye's image tracker: colour (or difference) likelihood → particles → mask → sub-pixel outline."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, Image, Mask
from tracking import masks
from tracking.color import ColorModel, color_bins, histogram
from tracking.ego_motion import Box
from tracking.outline import Optics, Outline
from tracking.particles import Cloud, ParticleParams, Prior, propagate, resample, spawn, weigh
from tracking.rim import see

_SPARSE = 0.5  # of the object's size: of a prior wider than that few particles would fall on the object


@dataclass(frozen=True)
class EyeParams:
    """`min_score` below which the object counts as not seen; `learn_rate` how fast its colours follow
    the newest image, `ring_rate` those of its surroundings, `size_rate` its size and proportions;
    `min_area_px` the smallest image; `reach` how far past its expected outline a mask may go;
    `notched`: what is no disc is taken for an object behind something, and completed (`rim.see`)."""

    particles: ParticleParams = field(default_factory=ParticleParams)
    min_score: float = 0.4
    learn_rate: float = 0.03
    ring_rate: float = 0.2
    size_rate: float = 0.3
    min_area_px: float = 10.0
    reach: float = 1.25
    notched: bool = True

    def __post_init__(self) -> None:
        if not (0 < self.min_score < 1 and self.reach > 1 and 0 <= self.size_rate <= 1):
            raise ValueError(
                f"least score {self.min_score}, reach {self.reach}, size rate {self.size_rate}: "
                "expected a score in (0, 1), a reach above 1 and a rate in [0, 1]"
            )


class Sighting(NamedTuple):
    """The object in one image: its outline, its box (x, y, width, height px) with the size smoothed
    over time, and how well appearance and area fit, 0–1."""

    outline: Outline
    box_px: tuple[float, float, float, float]
    score: float


@dataclass(frozen=True, slots=True)
class _State:
    model: ColorModel
    cloud: Cloud
    size: float  # √(width·height) of the box, px
    shape: tuple[float, float]  # box sides at unit size
    fill: float  # share of the box that the object covers
    spread: float  # how far it extends relative to an ellipse of its area


class EyeTracker:
    """Follows one object in one camera's images.  `start` learns it, `step` finds it again."""

    def __init__(self, params: EyeParams, optics: Optics, rng: np.random.Generator) -> None:
        self.params, self.optics, self.rng = params, optics, rng
        self._state: _State | None = None

    @property
    def model(self) -> ColorModel | None:
        """What the object looks like; None before `start`."""
        return self._state.model if self._state else None

    def forget(self) -> None:
        """Track nothing any more."""
        self._state = None

    def start(
        self,
        image: Image,
        box: tuple[float, float, float, float],
        model: ColorModel | None = None,
        spread: float = 1.0,
        shift_px: Array | None = None,
    ) -> None:
        """Learn the object that fills `box` (x, y, w, h px), or take its colours from another `model`;
        `spread` is 1 for an ellipse, and more for what has corners or limbs; `shift_px` (2,) is its motion from one
        image to the next (None: at rest)."""
        x, y, w, h = box
        center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        roi = self._region(center, 1.2 * w + 4, 1.2 * h + 4)
        bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
        inside, around = masks.ellipse(roi, center, 0.9 * w, 0.9 * h), masks.ellipse(roi, center, 1.2 * w, 1.2 * h)
        model = model or ColorModel(histogram(bins[inside]), histogram(bins[~around]))
        size, aspect = float(np.sqrt(w * h)), float(np.sqrt(w / h))
        shape = (aspect, 1 / aspect)
        mask = self._mask(model.table()[bins], model.backdrop()[bins], roi, center, size, shape, spread)
        whole = None if mask is None else see(image, mask, roi, self.optics, notched=self.params.notched)
        fill = np.pi / 4 if whole is None else min(whole.area_px / (w * h), 1.0)  # in the measure `step` uses
        cloud = spawn(self.params.particles, center, size, 0.5, self.rng, shift_px)
        self._state = _State(model, cloud, size, shape, fill, spread)

    def step(
        self, image: Image, prior: Prior | None = None, evidence: NDArray[np.float32] | None = None
    ) -> Sighting | None:
        """Find the object in the next image; None where it does not show.

        `evidence` (H, W) replaces the colour likelihood where there is no colour (grey images).
        """
        if self._state is None:
            return None
        s, p = self._state, self.params.particles
        if prior:
            s = replace(s, size=s.size * prior.growth)
            if prior.std_px > _SPARSE * s.size:
                prior = self._narrowed(s, image, prior, evidence)
        cloud = propagate(p, s.cloud, prior, self.rng)
        middle, reach = cloud.now[:, :2].mean(axis=0), 2.0 * cloud.now[:, :2].std(axis=0)
        half = self.params.reach * max(s.spread, 1.0) * s.size * np.array(s.shape) / 2 + reach + 4
        roi = self._region(middle, *half)
        if roi[2] - roi[0] < 4 or roi[3] - roi[1] < 4:
            return None
        crop = np.s_[roi[1] : roi[3], roi[0] : roi[2]]
        bins = color_bins(image[crop])
        likelihood = s.model.table()[bins] if evidence is None else evidence[crop]
        weights = weigh(p, cloud, _integral(2 * likelihood - 1), roi[:2], s.shape)
        center = _mode(cloud, weights, s.size)
        self._state = s = replace(s, cloud=resample(cloud, weights, self.rng))
        backdrop = None if evidence is not None else s.model.backdrop()[bins]
        mask = self._mask(likelihood, backdrop, roi, center, s.size, s.shape, s.spread)
        shape = None if mask is None else see(image, mask, roi, self.optics, s.fill * s.size**2, self.params.notched)
        if mask is None or shape is None:
            return None
        ratio = shape.area_px / (s.fill * s.size**2)
        score = s.model.similarity(histogram(bins[mask])) if evidence is None else float(likelihood[mask].mean())
        score *= min(ratio, 1 / ratio)
        if score < self.params.min_score:
            return None
        return self._learn(s, bins, mask, shape, score, ratio)

    def carry(self, shape: Outline) -> None:
        """Let the cloud follow an outline that was found without it; the colours stay what they are."""
        if self._state is not None:
            s, size = self._state, float(np.sqrt(shape.area_px / self._state.fill))
            self._state = replace(s, cloud=_moved_to(s.cloud, shape.center_px, size), size=size)

    def _narrowed(self, s: _State, image: Image, prior: Prior, evidence: NDArray[np.float32] | None) -> Prior:
        """A prior so wide that hardly a particle would fall on the object, about the place in it where something of
        the object's size stands out the most from what surrounds it."""
        w, h = (s.size * side for side in s.shape)
        roi = self._region(prior.center_px, 2 * prior.std_px + w, 2 * prior.std_px + h)
        if roi[2] <= roi[0] or roi[3] <= roi[1]:
            return prior
        crop = np.s_[roi[1] : roi[3], roi[0] : roi[2]]
        likelihood = s.model.table()[color_bins(image[crop])] if evidence is None else evidence[crop]
        inside, wider = (_box_mean(likelihood, w * k, h * k) for k in (1, 2))
        x, y = (np.arange(roi[k], roi[k + 2]) - prior.center_px[k] for k in (0, 1))
        far = (x * x)[None, :] + (y * y)[:, None]
        log = self.params.particles.sharpness * 4 / 3 * (inside - wider) - far / (2 * prior.std_px**2)
        row, column = np.unravel_index(int(np.argmax(log)), log.shape)
        return Prior(np.array([roi[0] + column, roi[1] + row]), 0.25 * s.size, prior.growth)

    def _learn(
        self, s: _State, bins: NDArray[np.uint8], mask: Mask, shape: Outline, score: float, ratio: float
    ) -> Sighting:
        """Let cloud, size and colours follow what was seen."""
        k = self.params.size_rate
        size = s.size * ratio ** (0.5 * k)
        seen_aspect = s.shape[0] ** 2 if shape.at_border else shape.box_px[2] / shape.box_px[3]
        aspect = (s.shape[0] ** 2) ** (1 - k) * seen_aspect**k
        newest = ColorModel(histogram(bins[mask]), histogram(bins[~masks.dilated(mask, 2)]))
        model = s.model.blend(newest, self.params.learn_rate, self.params.ring_rate)
        sides = (float(np.sqrt(aspect)), float(1 / np.sqrt(aspect)))
        self._state = _State(model, _moved_to(s.cloud, shape.center_px, size), size, sides, s.fill, s.spread)
        w, h = size * sides[0], size * sides[1]
        box = (float(shape.center_px[0] - (w - 1) / 2), float(shape.center_px[1] - (h - 1) / 2), w, h)
        return Sighting(shape, box, score)

    def _region(self, center: Array, half_w: float, half_h: float) -> Box:
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
        spread: float,
    ) -> Mask | None:
        """The object's pixels near `center`, holes filled; None where there are too few.

        What reaches past the expected outline is cut off there, and what is much thinner than the
        object (a limb of the same colour) is opened away.
        """
        hard: Mask = np.asarray(cv2.GaussianBlur(likelihood, (3, 3), 0)) > 0.5
        if size >= 12:
            hard = masks.closed(hard, masks.square(1))
        w, h = size * shape[0], size * shape[1]
        one = hard
        for _ in range(2):
            found = masks.component(hard, masks.ellipse(roi, center, 0.6 * w, 0.6 * h))
            if found is None:
                return None
            one = found
            reach = self.params.reach * spread
            allowed = masks.ellipse(roi, center, reach * w, reach * h)
            if not (one & ~allowed).any():
                break
            one = _without_limbs(one & allowed, size)
            ys, xs = np.nonzero(one)
            center = np.array([roi[0] + xs.mean(), roi[1] + ys.mean()])
        whole = masks.filled(one, backdrop)
        return whole if np.count_nonzero(whole) >= self.params.min_area_px else None


def _moved_to(cloud: Cloud, center_px: Array, size: float) -> Cloud:
    """The cloud about another centre (2,), with another mean size."""
    now = cloud.now.copy()
    now[:, :2] += center_px - now[:, :2].mean(axis=0)
    now[:, 2] *= size / now[:, 2].mean()
    return Cloud(now, cloud.before)


def _mode(cloud: Cloud, weights: Array, size: float) -> Array:
    """The weighted mean of the particles around the best one: between two candidates lies neither."""
    away = cloud.now[:, :2] - cloud.now[np.argmax(weights), :2]
    near = weights * (np.vecdot(away, away) < (0.5 * size) ** 2)
    mean: Array = near @ cloud.now[:, :2] / near.sum()
    return mean


def _box_mean(values: NDArray[np.float32], width: float, height: float) -> NDArray[np.float32]:
    sides = (2 * int(width / 2) + 1, 2 * int(height / 2) + 1)
    return np.asarray(cv2.boxFilter(values, cv2.CV_32F, sides, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def _integral(values: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.asarray(cv2.integral(values, sdepth=cv2.CV_64F), dtype=np.float64)


def _without_limbs(mask: Mask, size: float) -> Mask:
    """Without what is less than half as wide as the object; the mask itself where that leaves little."""
    if size <= 12:
        return mask
    core = masks.opened(mask, masks.disc(int(0.22 * size)))
    return core if np.count_nonzero(core) > 0.3 * np.count_nonzero(mask) else mask
