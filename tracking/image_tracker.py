"""Image tracker of one camera: colour likelihood → particle filter → mask → sub-pixel outline (R Fig 13)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.geometry.compiled import Vector
from pps_vision.jit import njit
from pps_vision.types import Array, CameraName, Detection2D, Image, Mask
from tracking import masks
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.background import Background
from tracking.background_edge import LEARNED_EDGE
from tracking.ego_motion import Box, EgoMotion
from tracking.kalman import Belief
from tracking.marker import MarkerParams, find_markers
from tracking.moving_background import MovingBackground
from tracking.outline import Optics, Outline, fit_outline
from tracking.particle_filter import SHARPNESS, Cloud, Prior, propagate, resample, spawn, weigh
from tracking.stereo import CameraFrame

Evidence = Callable[[Box], NDArray[np.float32] | Mask]
"""(h, w) probability that each pixel of a box is not the background, or whether it differs from it."""
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
_SEPARABLE = 0.8  # Bhattacharyya coefficient of an object's and its surroundings' colours up to which they tell it
_WIDE_PRIOR = 0.5  # of the object's size: with a wider prior few particles would fall on the object
_WIDE_SEARCH = 1.2  # of the object's size: within two of it 1 m/s may reverse from one image to the next
_GAP = 0.05  # of the object's size: gaps up to twice as wide are closed in what differs from the background
_THIN = 0.22  # of the object's size: radius of the disc that opens its mask
_SAME_SIZE = 0.03  # from one frame to the next the size of a wholly visible object is predicted this well
_MIN_SCORE = 0.4  # below which the object counts as not seen
_LARGER_BLOB = 1.25  # ratio of a marker's areas in two images in a row, above which its hue does not separate it
_LEARN_RATE, _BACKGROUND_RATE = 0.03, 0.2  # at which the colours of the object and its surroundings follow the image
_SIZE_RATE = 0.3  # the same for its size and proportions
_MIN_AREA_PX = 10  # smallest image of an object
_CORE = (
    0.75  # share of a mask left without its thin parts, below which they are the object's own (octopus 0.6, leaks 0.9)
)
_REACH = 1.25  # largest mask, as a multiple of the expected size
_RESTS_PX, _FAR_M = 1.0, 1.2  # shift from one image to the next of what rests; distance of most static things
_EMPTY, _SURE = 0.25, -3.0  # sum of `learned_edge` beyond `LEARNED_EDGE` that makes a place empty; and least sum
# Chosen on independent films of two equal balls and of fast reversals, seeds 4107 and 4129-4141.
_TOUCHING = 0.25  # of the object's area, what is joined with it beyond its reach if another thing touches it
_PASSING = 5  # images for which the two may hide each other then
_BESIDE = 0.05  # of its size, by which it may then be off the prediction beside its standard deviation
_MIN_STD_PX, _MAX_STD_PX = 0.7, 40.0  # of a prior
WHOLE = 1.5  # times the area of what is followed, from which another region is the whole of which that is a part


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
    cloud: Cloud
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
        cloud = spawn(self.params.particles, center, size, 0.5, self.rng, shift_px)
        return Target(model, cloud, size, shape, fill)

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
            colors = np.take(s.model.table(), bins)
            if evidence is None:
                return bins, colors
            changed = evidence(roi)
            if not by_color:
                return bins, np.asarray(changed, np.float32)
            return bins, np.asarray(cv2.copyTo(colors, np.asarray(changed > 0.5).view(np.uint8)), np.float32)

        if prior:
            s = replace(s, size=s.size * prior.growth)
            if prior.std_px > _WIDE_PRIOR * s.size:
                prior = self._narrowed(s, prior, likelihood_in)
        cloud = propagate(s.cloud, prior, self.rng)
        middle, reach = cloud.now[:, :2].mean(axis=0), 2.0 * cloud.now[:, :2].std(axis=0)
        half = _REACH * s.size * np.array(s.shape) / 2 + reach + 4
        roi = self.region(middle, *half)
        if roi[2] - roi[0] < 4 or roi[3] - roi[1] < 4:
            return s, None
        bins, likelihood = likelihood_in(roi)
        weights = weigh(cloud, _integral(2 * likelihood - 1), roi[:2], s.shape)
        center = _mode(cloud, weights, s.size)
        s = replace(s, cloud=resample(cloud, weights, self.rng))
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
        if score < _MIN_SCORE:
            return s, None
        return self._learn(s, bins, mask, outline, score, ratio)

    def follow(self, target: Target, outline: Outline) -> Target:
        """The target moved to an outline that was found without it; its colours stay."""
        size = float(np.sqrt(outline.area_px / target.fill))
        return replace(target, cloud=_moved_to(target.cloud, outline.center_px, size), size=size)

    def _narrowed(
        self, s: Target, prior: Prior, likelihood_in: Callable[[Box], tuple[NDArray[np.uint8], NDArray[np.float32]]]
    ) -> Prior:
        """Instead of a wide prior, one around the place in it where something of the object's size stands out most
        from its surroundings."""
        w, h = (s.size * side for side in s.shape)
        roi = self.region(prior.center_px, 2 * prior.std_px + w, 2 * prior.std_px + h)
        if roi[2] <= roi[0] or roi[3] <= roi[1]:
            return prior
        likelihood = likelihood_in(roi)[1]
        inside, wider = (_box_mean(likelihood, w * k, h * k) for k in (1, 2))
        x, y = (np.arange(roi[k], roi[k + 2]) - prior.center_px[k] for k in (0, 1))
        far = (x * x)[None, :] + (y * y)[:, None]
        log = SHARPNESS * 4 / 3 * (inside - wider) - far / (2 * prior.std_px**2)
        row, column = np.unravel_index(int(np.argmax(log)), log.shape)
        return Prior(np.array([roi[0] + column, roi[1] + row]), 0.25 * s.size, prior.growth)

    def _learn(
        self, s: Target, bins: NDArray[np.uint8], mask: Mask, outline: Outline, score: float, ratio: float
    ) -> tuple[Target, ImageDetection]:
        """Cloud, size and colours follow what was seen; the size only where the whole object was."""
        k = _SIZE_RATE
        size = s.size if outline.is_partial else s.size * ratio ** (0.5 * k)
        seen_aspect = s.shape[0] ** 2 if outline.is_partial else outline.box_px[2] / outline.box_px[3]
        aspect = (s.shape[0] ** 2) ** (1 - k) * seen_aspect**k
        newest = ColorModel(histogram(bins[mask]), histogram(bins[~masks.dilated(mask, 2)]))
        model = s.model.blend(newest, _LEARN_RATE, _BACKGROUND_RATE)
        sides = (float(np.sqrt(aspect)), float(1 / np.sqrt(aspect)))
        target = Target(model, _moved_to(s.cloud, outline.center_px, size), size, sides, s.fill, s.touched)
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


def _moved_to(cloud: Cloud, center_px: Array, size: float) -> Cloud:
    """The cloud about another centre (2,), with another mean size."""
    now = cloud.now.copy()
    now[:, :2] += center_px - now[:, :2].mean(axis=0)
    now[:, 2] *= size / now[:, 2].mean()
    return Cloud(now, cloud.before)


def _mode(cloud: Cloud, weights: Array, size: float) -> Array:
    """Weighted mean of the particles around the best one; the mean of all may lie between two candidates."""
    away = cloud.now[:, :2] - cloud.now[np.argmax(weights), :2]
    near = weights * (np.vecdot(away, away) < (0.5 * size) ** 2)
    mean: Array = near @ cloud.now[:, :2] / near.sum()
    return mean


def _box_mean(values: NDArray[np.float32], width: float, height: float) -> NDArray[np.float32]:
    sides = (2 * int(width / 2) + 1, 2 * int(height / 2) + 1)
    return np.asarray(cv2.boxFilter(values, cv2.CV_32F, sides, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def _integral(values: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.asarray(cv2.integral(values, sdepth=cv2.CV_64F), dtype=np.float64)


class CameraState(NamedTuple):
    """What one camera's tracker knows of the object."""

    target: Target | None = None
    """Of the image tracker; None before an object is found."""
    offset_px: tuple[float, float] = (0.0, 0.0)
    """From the track's projection to the outline's centre: calibration error."""
    size_px: float = 0.0
    """Apparent diameter."""
    by_background: bool = False
    """Whether it is followed by what differs from the background, since colours do not separate it."""
    emptiness: float = 0.0
    """Evidence that it is the empty place of something that was learned as background: the sum over images of
    `learned_edge` beyond `LEARNED_EDGE` where it rests."""
    view: View | None = None
    """Last pose of the camera."""


class CameraTracker:
    """One camera's tracker: where the track predicts the object, and where it is.  Holds no state but the
    background."""

    def __init__(
        self,
        name: CameraName,
        optics: Optics,
        params: ImageTrackerParams,
        marker: MarkerParams | None,
        background_memory_s: float,
        rng: np.random.Generator,
    ) -> None:
        self.name, self.optics, self.marker = name, optics, marker
        self.image_tracker = ImageTracker(params, optics, rng)
        self.background = Background(EgoMotion(optics.camera), background_memory_s)

    def predict(self, state: CameraState, camera: CameraFrame, last: Belief, now: Belief) -> Prior | None:
        """Where the belief says that this camera sees the object; None outside the image."""
        x, y, z = _position_at(now, camera.stamp_s)
        u, v, of_u, of_v = camera.view.project_linearised(x, y, z)
        center = u + state.offset_px[0], v + state.offset_px[1]
        if not self.optics.camera.contains(center, margin_px=-0.5 * state.size_px):
            return None
        eye = camera.view.place
        growth = math.dist(last.mean[0].tolist(), eye) / math.dist((x, y, z), eye)
        std_px = min(max(_std_px(now.cov, of_u, of_v), _MIN_STD_PX), _MAX_STD_PX)
        return Prior(np.array(center), std_px, min(max(growth, 0.8), 1.25))

    def find(
        self, state: CameraState, camera: CameraFrame, prior: Prior | None
    ) -> tuple[CameraState, ImageDetection | None]:
        """The object near its prior, None where it is not found: one of `camera.found` (`batch`), else searched."""
        if prior is None:
            return state, None
        given = None if state.by_background else self._given(state, camera.found or [], prior)
        if given is None and self.marker is not None:
            given, is_hue_there = self._find_marker(self.marker, state, camera, prior)
            if given is None and not is_hue_there:
                return state, None
        if given is not None:
            target = state.target and self.image_tracker.follow(state.target, given.outline)
            return state._replace(target=target), given
        if state.target is None:
            return state, None
        before, background, different = state.target, self._known_background(camera), None
        if background is not None:
            of_pixels = background.evidence if state.by_background else background.differs
            different = partial(of_pixels, camera.image, camera.view)
        elif state.by_background:  # colours must do
            if before.model.similarity(before.model.background) > _SEPARABLE:
                return state, None
            state = state._replace(by_background=False)
        # before a moving eye colours alone do better where they separate the object
        evidence = different if state.by_background or background is self.background else None
        search = partial(self.image_tracker.step, before, camera.image, by_color=not state.by_background)
        target, found_object = search(prior, evidence, if_joined=different)
        if found_object is None and evidence is None and different is not None:
            evidence = different
            target, found_object = search(prior, evidence)
        if found_object is None and evidence is not None and not before.touched:  # it has turned abruptly
            last_px = before.cloud.now[:, :2].mean(axis=0)
            target, found_object = search(Prior(last_px, _WIDE_SEARCH * before.size, prior.growth), evidence)
        if self.marker is not None and found_object is not None and found_object.outline.is_partial:
            return state, None  # what hides it may have its hue
        if found_object is not None and state.by_background:
            emptiness = self._emptiness(state, camera, before, found_object)
            state = state._replace(emptiness=emptiness)
        return state._replace(target=target, view=camera.view), found_object

    def _emptiness(self, state: CameraState, camera: CameraFrame, before: Target, found: ImageDetection) -> float:
        """The state's `emptiness` after another image."""
        place = self._changed_place(camera, found)
        share = None if place is None else self.background.learned_edge(camera.image, camera.view, *place)
        if share is None:
            return state.emptiness
        was_px = before.cloud.now[:, :2].mean(axis=0)
        if state.view is not None and state.view is not camera.view:
            was_px = camera.view.project(state.view.center + _FAR_M * state.view.rays(was_px))
        rests = math.dist(was_px.tolist(), found.outline.center_px.tolist()) < _RESTS_PX
        change = share - LEARNED_EDGE
        return max(state.emptiness + (change if rests else min(change, 0.0)), _SURE)

    def _known_background(self, camera: CameraFrame) -> Background | MovingBackground | None:
        """The background of the eye, at rest or moving; None where it is unknown, or the eye moves and follows a
        marker, which needs none."""
        if self.background.is_known(camera.view):
            return self.background
        return None if self.marker else self.background.behind_moving_eye(camera.view, camera.stamp_s)

    def _changed_place(self, camera: CameraFrame, found: ImageDetection) -> tuple[Mask, Box] | None:
        """What differs from the background where an object was found: a mask (h, w) of a box; None if nothing does."""
        background = self._known_background(camera)
        if background is None:
            return None
        _, _, w, h = found.outline.box_px
        box = self.image_tracker.region(found.outline.center_px, 0.5 * w + 4, 0.5 * h + 4)
        differs = background.differs(camera.image, camera.view, box)
        mask = masks.component(differs, masks.ellipse(box, found.outline.center_px, w, h))
        return None if mask is None else (mask, box)

    def is_part(self, state: CameraState, camera: CameraFrame, found: ImageDetection) -> bool:
        """Whether the object, followed by its colours, is a part of a larger solid region that differs from the
        background; not if it is a disc, since a disc is whole."""
        outline = found.outline
        background = None if outline.is_disc or state.by_background else self._known_background(camera)
        if background is None:
            return False
        half = 2.0 * max(outline.box_px[2:])
        box = self.image_tracker.region(outline.center_px, half, half)
        evidence = background.evidence(camera.image, camera.view, box)
        around = masks.ellipse(box, outline.center_px, *outline.box_px[2:])
        whole = masks.component(np.asarray(evidence > 0.5), around)
        if whole is None or np.count_nonzero(whole) < WHOLE * outline.area_px:
            return False
        return not masks.is_cut(whole, box, camera.image) and masks.solidity(whole) > masks.SOLID

    def absorb(self, camera: CameraFrame, found: ImageDetection) -> None:
        """Learn what an object's place shows as background."""
        place = self._changed_place(camera, found)
        if place is not None:
            mask, box = place
            self.background.absorb(camera.image, camera.view, camera.stamp_s, masks.dilated(mask, 2), box)

    def _find_marker(
        self, marker: MarkerParams, state: CameraState, camera: CameraFrame, prior: Prior
    ) -> tuple[ImageDetection | None, bool]:
        """The blob nearest to the prior, unless its area is quite another: its hue does not separate it then; and
        whether there is any blob."""
        x, y = prior.center_px.tolist()
        near, area_px = (x, y, state.size_px + 4 * prior.std_px + 3), math.pi / 4 * (prior.growth * state.size_px) ** 2
        differs = partial(self.background.differs, camera.image, camera.view)
        found = find_markers(marker, camera.image, self.optics, near, differs=differs, expected_area_px=area_px)
        nearest = min(found, key=lambda one: math.dist(one.center_px.tolist(), (x, y)), default=None)
        if nearest is None:
            return None, False
        ratio = (self._size_px(nearest) / (prior.growth * state.size_px)) ** 2
        if not _MIN_SCORE <= ratio <= _LARGER_BLOB:
            return None, True
        return ImageDetection(nearest, nearest.box_px, min(ratio, 1 / ratio)), True

    def _given(self, state: CameraState, found: list[Outline], prior: Prior) -> ImageDetection | None:
        """The one of the outlines `found` beforehand that lies near the prior and is as large as predicted."""
        half, expected_px = 0.5 * state.size_px + 2 * prior.std_px + 4, prior.growth * state.size_px
        for one in found:
            near = float(np.abs(one.center_px - prior.center_px).max()) < half
            if near and abs(self._size_px(one) / expected_px - 1) < _SAME_SIZE:
                return ImageDetection(one, one.box_px, 1.0)
        return None

    @staticmethod
    def is_empty(state: CameraState) -> bool:
        """Whether what is followed is the empty place of something that was learned as background."""
        return state.emptiness > _EMPTY

    def remember(self, state: CameraState, camera: CameraFrame, outline: Outline, belief: Belief) -> CameraState:
        """The state with the object's offset from the track and its size."""
        u, v, _, _ = camera.view.project_linearised(*_position_at(belief, camera.stamp_s))
        x, y = outline.center_px.tolist()
        return state._replace(offset_px=(x - u, y - v), size_px=self._size_px(outline))

    def detection(self, camera: CameraFrame, found: ImageDetection) -> Detection2D:
        """The message of an image detection."""
        shape = found.outline
        return Detection2D(
            *(camera.stamp_s, self.name, shape.center_px, shape.cov_px),
            *(found.score, shape.angular_radius_rad, found.box_px),
        )

    def _size_px(self, outline: Outline) -> float:
        return 2 * outline.angular_radius_rad * self.optics.camera.focal_px


def _position_at(belief: Belief, stamp_s: float) -> Vector:
    """The object's position when a camera's image was taken, which may differ from the belief's stamp."""
    (x, y, z), *rates = belief.mean.tolist()
    if not rates:
        return x, y, z
    dt, (vx, vy, vz) = stamp_s - belief.stamp_s, rates[0]
    return x + vx * dt, y + vy * dt, z + vz * dt


@njit(cache=True, error_model="numpy")
def _std_px(cov: Array, of_u: Vector, of_v: Vector) -> float:
    """Standard deviation (px) of the image of a point: `cov`'s first three rows and columns are its covariance (m²),
    `of_u` and `of_v` the derivatives of the pixel by it (px/m)."""
    var = 0.0
    for i in range(3):
        for j in range(3):
            var += cov[i, j] * (of_u[i] * of_u[j] + of_v[i] * of_v[j])
    return math.sqrt(var)
