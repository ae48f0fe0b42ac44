"""Image tracker of one camera: prediction from the 3D track → evidence for the particle filter → mask near the located
object → sub-pixel outline.  `ImageTracker` follows in the image alone, `CameraTracker` with a track, or a marker's hue.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry import masks
from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.compiled import Vector
from pps_vision.geometry.masks import Box, BoxPx
from pps_vision.types import Array, CameraName, Detection2D, Image, Mask
from tracking.appearance import SEPARABLE, ColorModel, color_bins, histogram, share
from tracking.foreground import HIDING, Background, ForegroundParams, foreground_around
from tracking.kalman import Belief
from tracking.marker import MIN_AREA_PX, MarkerParams, colors_of, find_markers
from tracking.outline import (
    SIZE_ERROR,
    Optics,
    Outline,
    at_visible_edge,
    beside_foreground,
    fit_outline,
    fit_visible_edge,
)
from tracking.particle_filter import Evidence, Eye, Located, Map, Silhouette, template_of
from tracking.stereo import CameraFrame

Foreground = Callable[[Box], tuple[Map, Mask]]
"""Box → probability (h, w) that a pixel differs from the background, and whether that is known there (h, w)."""
SegmentedBy = Literal["colour", "colour and foreground", "foreground"]
_GAP = 0.05  # half the width, in object sizes, of gaps that are closed in a foreground mask
_THIN = 0.22  # radius, in object sizes, of the disc that opens its mask
MIN_SCORE = 0.4  # score, or visible share, below which the object is not detected
RATE = 0.05  # update rate of the object's colours, and of the ratio of its measured and predicted size
_FAST_RATE = 0.2  # the same of the colours around it, and of the sides of its box
# Share of a mask without its thin parts below which these belong to the object (octopus 0.6, leaks 0.9).
_CORE = 0.75
_REACH = 1.25  # largest mask, as a multiple of the expected size; what is farther from the centre is another object's
_TOUCHING = 0.25  # area beyond the reach, relative to the object's, from which another object touches it
SIZE_FRAMES = 10  # frames in which an object was wholly visible after which its size is known
_MIN_RATIO_STD = 0.005
_ERRORS = 3.0  # standard deviations of that ratio below its mean from which part of the object is hidden
_THIN_PX = 2  # half the width of foreground that hides nothing, such as the rim of a shadow or of what moved
_FREE = 0.05  # foreground around a whole object, at most
_RIVAL = -0.3  # evidence of a foreground pixel of another colour: it may be in front of the object
_OFF_PREDICTION = 0.05  # largest distance of an outline from its prediction, in object sizes, added to three deviations
_MIN_INSIDE = 0.1  # least distance of the centre of a partly visible object from the border, in object sizes
_PARTICLE_PX = 0.3  # systematic error of the particles' centre
_OTHER_SHAPE = 0.15  # error of the centre of an object that may have turned since its silhouette was seen, in radii
_LARGER_BLOB = 1.25  # ratio of a marker's areas in two images in a row above which its hue does not separate it


class ImageDetection(NamedTuple):
    """Detection in one image: outline, box (size smoothed over time), and similarity of colours and area, 0–1."""

    outline: Outline
    box_px: BoxPx
    score: float


@dataclass(frozen=True, slots=True)
class Target:
    """State of the image tracker.

    Attributes:
        model: Colours.
        rivals: (N_BINS,) colours of other foreground beside the object.
        shape: Width and height of the box (px) per radian of the angular radius.
        angle_rad: Predicted angular radius.
        silhouette: When it was last wholly visible; None: a ball's.
        ratio: Mean ratio of the measured angular radius to the predicted one.
        ratio_std: Its standard deviation.
        frames: Number of frames in which the object was wholly visible.
    """

    model: ColorModel
    rivals: Array
    shape: tuple[float, float]
    angle_rad: float
    silhouette: Silhouette | None
    ratio: float = 1.0
    ratio_std: float = 0.05
    frames: int = 0

    @property
    def box(self) -> tuple[float, float]:
        """Width and height of the expected box, px."""
        return self.shape[0] * self.angle_rad, self.shape[1] * self.angle_rad

    @property
    def is_size_known(self) -> bool:
        """Whether the object's size is known well enough to detect a partial occlusion."""
        return self.frames >= SIZE_FRAMES

    @property
    def size(self) -> float:
        """√(width·height) of the expected box, px."""
        return math.sqrt(self.shape[0] * self.shape[1]) * self.angle_rad


@dataclass(frozen=True)
class Examined:
    """Region of an image around the predicted object.

    Attributes:
        target: The object.
        camera: The image's.
        roi: The region.
        bins: (h, w) colour bins.
        colors: (h, w) likelihood of the object by its colours.
        segmented_by: What separates the object from its surroundings.
        difference: (h, w) probability of foreground, or unknown background; None without a known background.
        covered: (h, w) foreground in front of known background.
    """

    target: Target
    camera: Camera
    roi: Box
    bins: NDArray[np.uint8]
    colors: Map
    segmented_by: SegmentedBy
    difference: Map | None
    covered: Mask

    @cached_property
    def changed(self) -> Mask | None:
        """(h, w) foreground, or unknown background; None without a known background."""
        return None if self.difference is None else self.difference > 0.5

    def likelihoods(self) -> Iterator[tuple[Map, Mask | None]]:
        """Likelihoods (h, w) that segment the object, the most accurate first, each with a mask of likely background
        (None: unknown)."""
        if self.segmented_by == "foreground":
            if self.difference is not None:
                yield self.difference, None
            return
        backdrop = self.target.model.backdrop()[self.bins]
        if self.segmented_by == "colour":
            yield self.colors, backdrop
        if self.changed is not None:
            yield self.colors * self.changed, ~self.changed & backdrop

    @cached_property
    def evidence(self) -> Evidence:
        """Input of the particle filter."""
        model = self.target.model
        inside = 2 * self.colors - 1
        if self.changed is not None:
            among_changed = np.take(2 * share(model.object, self.target.rivals) - 1, self.bins)
            unchanged = np.take(np.float32(model.object / model.object.max()) - 1, self.bins)
            inside = np.where(self.changed, np.maximum(among_changed, _RIVAL), unchanged)
        smooth = np.asarray(cv2.blur(np.asarray(inside, np.float32), (3, 3)), np.float32)
        return Evidence(smooth, (self.roi[0], self.roi[1]), (self.camera.width, self.camera.height))


class ImageTracker:
    """Tracks one object in one camera's images. Holds no state: `start` and `detect` return a `Target`."""

    def __init__(self, optics: Optics) -> None:
        self.optics = optics

    def start(
        self,
        image: Image,
        box: BoxPx,
        angle_rad: float,
        model: ColorModel | None = None,
        silhouette: Silhouette | None = None,
    ) -> Target:
        """Initial target.

        Args:
            image: RGB (H, W, 3).
            box: Box of the object.
            angle_rad: Its angular radius.
            model: Its colours; None: from the image.
            silhouette: Its silhouette; None: a disc.
        """
        x, y, w, h = box
        center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        roi = self.region(center, 1.2 * w + 4, 1.2 * h + 4)
        if model is None:
            bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
            inside = masks.ellipse(roi, center, 0.9 * w, 0.9 * h)
            around = masks.ellipse(roi, center, 1.2 * w, 1.2 * h)
            model = ColorModel(histogram(bins, inside), histogram(bins, ~around))
        rivals = np.zeros(len(model.object))
        return Target(model, rivals, (w / angle_rad, h / angle_rad), angle_rad, silhouette)

    def examine(
        self,
        target: Target,
        image: Image,
        center_px: Array,
        reach_px: float,
        foreground: Foreground | None,
        segmented_by: SegmentedBy,
    ) -> Examined | None:
        """The region of an image within `reach_px` of the object's predicted centre (2,); None outside of the image.

        Args:
            target: In the last image, at the size that is predicted for this one.
            image: RGB (H, W, 3).
            center_px: Predicted centre.
            reach_px: How far off it may be.
            foreground: Foreground of a box; None: the background is unknown.
            segmented_by: What separates the object from its surroundings.
        """
        w, h = target.box
        roi = self.region(center_px, _REACH * w / 2 + reach_px + 4, _REACH * h / 2 + reach_px + 4)
        if roi[2] - roi[0] < 4 or roi[3] - roi[1] < 4:
            return None
        bins = color_bins(image[roi[1] : roi[3], roi[0] : roi[2]])
        colors = np.take(target.model.table(), bins)
        difference = None
        is_covered = np.zeros(bins.shape, bool)
        if foreground is not None:
            difference, is_known = foreground(roi)
            is_covered = (difference > 0.5) & is_known
        return Examined(target, self.optics.camera, roi, bins, colors, segmented_by, difference, is_covered)

    def detect(
        self, target: Target, image: Image, examined: Examined, center_px: Array, by_color: bool
    ) -> tuple[Target, ImageDetection, Mask] | None:
        """The target, its detection at the centre (2,) where it was located, and its mask in the region; None if the
        mask is not its whole image."""
        for likelihood, backdrop in examined.likelihoods():
            whole = self._whole(target, image, examined, likelihood, backdrop, center_px, by_color)
            if whole is not None:
                return whole
        return None

    def _whole(
        self,
        target: Target,
        image: Image,
        examined: Examined,
        likelihood: Map,
        backdrop: Mask | None,
        center_px: Array,
        by_color: bool,
    ) -> tuple[Target, ImageDetection, Mask] | None:
        """As `detect`, segmented by one likelihood."""
        roi = examined.roi
        mask = self._mask(target, likelihood, backdrop, roi, center_px)
        if mask is None or masks.is_cut(mask, roi, image):
            return None
        outline = fit_outline(image, mask, roi, self.optics)
        if outline is None or outline.is_partial:
            return None
        around = foreground_around(mask, examined.covered)
        if target.silhouette is None:
            if around > HIDING:
                return None
        elif around > _FREE:
            hiding = masks.opened(examined.covered, _THIN_PX)
            outline = beside_foreground(outline, foreground_around(mask, hiding))
        ratio = outline.angular_radius_rad / target.angle_rad
        is_free = 2 * np.count_nonzero(examined.covered & mask) > np.count_nonzero(mask) and around < _FREE
        may_be_smaller = is_free if target.silhouette else outline.is_disc and (is_free or not target.is_size_known)
        if ratio < target.ratio - _ERRORS * target.ratio_std and not may_be_smaller:
            return None
        largest = target.ratio + max(_ERRORS * target.ratio_std, 2 * SIZE_ERROR)
        if target.is_size_known and ratio > largest:  # background of the object's colour beside it
            return None
        colors = histogram(examined.bins, mask)
        score = target.model.similarity(colors) if by_color else float(likelihood[mask].mean())
        score *= min(ratio, 1 / ratio) ** 2
        if score < MIN_SCORE:
            return None
        newest = ColorModel(colors, histogram(examined.bins, ~masks.dilated(mask, 2)))
        return *self._learn(target, newest, outline, score, ratio), mask

    def holds(self, target: Target, examined: Examined, center_px: Array) -> bool:
        """Whether the examined region holds the object at a centre (2,), as far as the image does."""
        w, h = (0.5 * _REACH * side for side in target.box)
        needed = self.region(center_px, w + 1, h + 1)
        return masks.contains(examined.roi, needed)

    def learn_rivals(self, target: Target, examined: Examined, center_px: Array) -> Target:
        """The target with the colours of the foreground beside the object, located at a centre (2,)."""
        w, h = (_REACH * side for side in target.box)
        seen: Array | float = 0.0
        if examined.changed is not None:
            beside = examined.changed & ~masks.ellipse(examined.roi, center_px, w, h)
            share_beside = min(np.count_nonzero(beside) / target.size**2, 1.0)
            seen = share_beside * histogram(examined.bins, beside) if share_beside > 0 else 0.0
        rivals = (1 - _FAST_RATE) * target.rivals + _FAST_RATE * seen
        return replace(target, rivals=rivals)

    def _learn(
        self, target: Target, newest: ColorModel, outline: Outline, score: float, ratio: float
    ) -> tuple[Target, ImageDetection]:
        """Update size, colours and those beside the object."""
        model = target.model.blend(newest, RATE, _FAST_RATE)
        boxes = zip(target.shape, outline.box_px[2:], strict=True)
        width, height = (side ** (1 - _FAST_RATE) * (px / target.angle_rad) ** _FAST_RATE for side, px in boxes)
        k = max(1 / (target.frames + 2), RATE)
        mean = target.ratio + k * (ratio - target.ratio)
        variance = (1 - k) * target.ratio_std**2 + k * (ratio - mean) ** 2
        learned = replace(
            target,
            model=model,
            shape=(width, height),
            ratio=mean,
            ratio_std=max(math.sqrt(variance), _MIN_RATIO_STD),
            frames=target.frames + 1,
        )
        w, h = learned.box
        x, y = outline.center_px.tolist()
        return learned, ImageDetection(outline, (x - (w - 1) / 2, y - (h - 1) / 2, w, h), score)

    def region(self, center: Array, half_w: float, half_h: float) -> Box:
        """Region of the image up to `half_w` and `half_h` (px) from a centre (2,)."""
        camera = self.optics.camera
        x, y = center
        box = (int(x - half_w), int(y - half_h), int(x + half_w) + 2, int(y + half_h) + 2)
        return masks.clipped(box, camera.width, camera.height)

    def _mask(self, target: Target, likelihood: Map, backdrop: Mask | None, roi: Box, center: Array) -> Mask | None:
        """Mask of the object near `center`; None if it is too small, or another object touches it.

        The mask is cut off beyond the expected outline, and parts that are much thinner than the object are removed by
        opening (background of the object's colour that touches it), unless they are much of the mask. Gaps and holes
        are filled, as object and background may have the same colour there, except with `backdrop`.
        """
        w, h = target.box
        hard: Mask = np.asarray(cv2.GaussianBlur(likelihood, (3, 3), 0)) > 0.5
        if target.size >= 12:
            wide = masks.closed(hard, masks.square(max(int(_GAP * target.size), 1)))
            hard = wide if backdrop is None else masks.closed(hard, masks.square(1)) | (wide & ~backdrop)
        component = masks.component(hard, masks.ellipse(roi, center, 0.6 * w, 0.6 * h))
        if component is None:
            return None
        expected = self._expected(target, roi, center)
        within = component & expected
        if within.any():
            expected = self._expected(target, roi, masks.centroid(within, roi))
            within = component & expected
        if beyond := np.count_nonzero(component) - np.count_nonzero(within):
            if beyond > _TOUCHING / _REACH**2 * np.count_nonzero(expected):
                return None
            component = _without_thin_parts(within, target.size)
        mask = masks.filled(component, backdrop)
        return mask if np.count_nonzero(mask) >= MIN_AREA_PX else None

    def _expected(self, target: Target, roi: Box, center: Array) -> Mask:
        """Pixels of `roi` that the object at `center` may cover: its last silhouette, or an ellipse, and a margin."""
        w, h = target.box
        if target.silhouette is None:
            return masks.ellipse(roi, center, _REACH * w, _REACH * h)
        silhouette = target.silhouette
        scale = target.angle_rad / silhouette.angle_rad
        shift = center - roi[:2] - scale * (silhouette.center_px - silhouette.box[:2])
        to_roi = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
        size = roi[2] - roi[0], roi[3] - roi[1]
        placed = np.asarray(cv2.warpAffine(silhouette.mask.view(np.uint8), to_roi, size, flags=cv2.INTER_NEAREST))
        margin_px = (_REACH - 1) * target.angle_rad * self.optics.camera.focal_px
        return masks.dilated(placed.view(bool), int(margin_px) + 1)


def _without_thin_parts(mask: Mask, size: float) -> Mask:
    """The mask without parts less than half as wide as the object; the mask itself where that leaves little."""
    if size <= 12:
        return mask
    core = masks.opened(mask, int(_THIN * size))
    return core if np.count_nonzero(core) > _CORE * np.count_nonzero(mask) else mask


class Prior(NamedTuple):  # constructing a frozen dataclass is three times slower
    """Predicted image: centre (2,) px with its standard deviation (px), distance (m), angular radius (rad), size, and
    the centre's gradient (2, 3) by the position (px/m)."""

    center_px: Array
    std_px: float
    distance_m: float
    angle_rad: float
    size_px: float
    by_position: Array = np.zeros((2, 3))

    def within(self, cov: Array) -> "Prior":
        """The prior of a position with the covariance `cov` (3, 3) m²."""
        return self._replace(std_px=math.sqrt(float((self.by_position @ cov * self.by_position).sum())))


class CameraState(NamedTuple):
    """State of one camera's tracker."""

    target: Target | None = None  # state of the image tracker; None before an object is acquired
    offset_px: tuple[float, float] = (0.0, 0.0)  # from the projected track to the outline's centre: calibration error
    by_background: bool = False  # whether the likelihood is the foreground, since colours do not separate the object
    marker: MarkerParams | None = None  # a marker's own colours


class CameraTracker:
    """Tracker of one camera. Holds no state but the background."""

    def __init__(
        self,
        name: CameraName,
        optics: Optics,
        marker: MarkerParams | None,
        foreground: ForegroundParams,
    ) -> None:
        self.name = name
        self.optics = optics
        self.marker = marker
        self.image_tracker = ImageTracker(optics)
        self.background = Background(foreground, optics.camera)

    def predict(
        self, state: CameraState, camera: CameraFrame, predicted: Belief, cov: Array, radius_m: float
    ) -> Prior | None:
        """Predicted image of an object whose position has the covariance `cov` (3, 3) m²; None outside of this one."""
        x, y, z = _position_at(predicted, camera.stamp_s)
        u, v, of_u, of_v = camera.view.project_linearised(x, y, z)
        center = (u + state.offset_px[0], v + state.offset_px[1])
        distance_m = math.dist((x, y, z), camera.view.place)
        angle_rad = math.asin(min(radius_m / distance_m, 0.9))
        size_px = 2 * angle_rad * self.optics.camera.focal_px
        if not self.optics.camera.contains(center, margin_px=-0.5 * size_px):
            return None
        return Prior(np.array(center), 0.0, distance_m, angle_rad, size_px, np.array((of_u, of_v))).within(cov)

    def quick(
        self, state: CameraState, camera: CameraFrame, prior: Prior
    ) -> tuple[CameraState, ImageDetection | None, bool]:
        """The object near its prior without a search of all pixels: from `camera.outlines` (`batch`) or by a marker's
        hue; and whether a search may find it."""
        detection = None if state.by_background else self._given(state, camera.outlines or [], prior)
        may_be_there = state.target is not None
        if detection is None and self.marker is not None:
            detection, is_hue_there = self._find_marker(self.marker, state, camera, prior)
            may_be_there &= is_hue_there
        if detection is None:
            return state, None, may_be_there
        return state, detection, False

    def eye(self, state: CameraState, camera: CameraFrame, predicted: Belief, evidence: Evidence) -> Eye:
        """This camera's input of the particle filter."""
        at_pair = camera.view.project_linearised(*predicted.mean[0].tolist())
        at_image = camera.view.project_linearised(*_position_at(predicted, camera.stamp_s))
        offset = (
            state.offset_px[0] + at_image[0] - at_pair[0],
            state.offset_px[1] + at_image[1] - at_pair[1],
        )
        template = template_of(None if state.target is None else state.target.silhouette)
        return Eye(camera.view, offset, template, evidence)

    def examine(self, state: CameraState, camera: CameraFrame, prior: Prior) -> tuple[CameraState, Examined | None]:
        """The region around the prior, and what separates the object from its surroundings there."""
        target = state.target
        if target is None:
            return state, None
        target = replace(target, angle_rad=prior.angle_rad)
        background = self._known_background(camera)
        if background is None and state.by_background:  # only colours are left
            if target.model.similarity(target.model.background) > SEPARABLE:
                return state, None
            state = state._replace(by_background=False)
        foreground = None
        if background is not None:
            of_pixels = background.evidence if state.by_background else background.differs
            foreground = partial(_foreground, of_pixels, background, camera)
        # in front of a moving camera, colours alone are more accurate where they separate the object
        segmented_by: SegmentedBy = "colour and foreground" if self.background.rests(camera.view) else "colour"
        if state.by_background:
            segmented_by = "foreground"
        examined = self.image_tracker.examine(
            target, camera.image, prior.center_px, 2 * prior.std_px, foreground, segmented_by
        )
        return state._replace(target=target), examined

    def whole(
        self, state: CameraState, camera: CameraFrame, examined: Examined, prior: Prior
    ) -> tuple[CameraState, ImageDetection] | None:
        """The object as its own outline shows it, if it is whole and as the prior tells."""
        if state.target is None:
            return None
        result = self.image_tracker.detect(
            state.target, camera.image, examined, prior.center_px, not state.by_background
        )
        if result is None:
            return None
        center_px = result[1].outline.center_px
        off_px = math.dist(center_px.tolist(), prior.center_px.tolist())
        if off_px > 3 * prior.std_px + _OFF_PREDICTION * prior.size_px:
            return None
        p_root = camera.view.center + prior.distance_m * camera.view.rays(center_px)
        return self._shown(state, camera, examined, result, p_root, prior.distance_m * math.sin(prior.angle_rad))

    def _shown(
        self,
        state: CameraState,
        camera: CameraFrame,
        examined: Examined,
        result: tuple[Target, ImageDetection, Mask],
        p_root: Array,
        radius_m: float,
    ) -> tuple[CameraState, ImageDetection] | None:
        """The object at `p_root` (3,) with its own outline and silhouette; None for the place that it has left."""
        target, detection, mask = result
        place = camera.image, camera.view, mask, examined.roi
        if state.by_background and self.background.is_ghost(*place):
            self.background.adopt(*place)
            return None
        outline = detection.outline
        seen = Silhouette(mask, examined.roi, camera.view, p_root, outline.center_px, radius_m)
        target = replace(target, silhouette=None if outline.is_disc else seen)
        return state._replace(target=target), detection

    def detect(
        self, state: CameraState, camera: CameraFrame, examined: Examined, located: Located, eye: int
    ) -> tuple[CameraState, ImageDetection | None]:
        """The object where the particle filter located it: its own outline if that is whole, else the particles'."""
        target = state.target
        if target is None:
            return state, None
        center_px = camera.view.project(located.p_root) + state.offset_px
        if not self.image_tracker.holds(target, examined, center_px):
            state, again = self.examine(state, camera, Prior(center_px, 0.0, math.nan, target.angle_rad, target.size))
            examined = again or examined
        target = self.image_tracker.learn_rivals(target, examined, center_px)
        state = state._replace(target=target)
        whole = self.image_tracker.detect(target, camera.image, examined, center_px, not state.by_background)
        if whole is not None:
            shown = self._shown(state, camera, examined, whole, located.p_root, located.radius_m)
            return shown or (state, None)
        if self.marker is not None or min(located.fill) < MIN_SCORE:  # a marker's occluder may have the same hue
            return state, None
        return state, self._partial(target, camera, examined, located, eye, center_px)

    def _partial(
        self, target: Target, camera: CameraFrame, examined: Examined, located: Located, eye: int, center_px: Array
    ) -> ImageDetection | None:
        """The object that is partly hidden: at its visible edge, else at the particles."""
        if not self.optics.camera.contains(center_px, margin_px=_MIN_INSIDE * min(target.box)):
            return None
        angle = math.asin(min(located.radius_m / math.dist(located.p_root, camera.view.place), 0.9))
        w, h = target.box
        x, y = center_px.tolist()
        outline = Outline(
            center_px=center_px,
            cov_px=_PARTICLE_PX**2 * np.eye(2),
            angular_radius_rad=angle,
            angular_radius_var=(SIZE_ERROR * angle) ** 2,
            box_px=(x - (w - 1) / 2, y - (h - 1) / 2, w, h),
            area_px=math.pi / 4 * w * h,
            is_partial=True,
        )
        radius_px = angle * self.optics.camera.focal_px
        region = examined.evidence.pixels, examined.covered, examined.roi
        fit = fit_visible_edge(camera.image, *region, *located.edges[eye], located.radius_std * radius_px)
        if fit is not None:
            outline = at_visible_edge(outline, fit, radius_px)
        if target.silhouette is not None:
            outline = replace(outline, hidden_px=_OTHER_SHAPE * radius_px)
        return ImageDetection(outline, outline.box_px, located.fill[eye])

    def _known_background(self, camera: CameraFrame) -> Background | None:
        """The background; None if unknown, or for a marker if the camera moves."""
        rests = self.background.rests(camera.view)
        return self.background if rests or (self.background.is_known and self.marker is None) else None

    def _find_marker(
        self, marker: MarkerParams, state: CameraState, camera: CameraFrame, prior: Prior
    ) -> tuple[ImageDetection | None, bool]:
        """The blob of the marker's own colours, else of its hue, nearest to the prior, None if its area does not fit
        (then its hue does not separate it); and whether there is any blob."""
        x, y = prior.center_px.tolist()
        near = (x, y, prior.size_px + 4 * prior.std_px + 3)
        area_px = math.pi / 4 * prior.size_px**2
        rests = self.background.rests(camera.view)
        differs = partial(self.background.differs, camera.image, camera.view) if rests else None
        is_there = False
        for part in (state.marker, marker):
            if part is None:
                continue
            blobs = find_markers(part, camera.image, self.optics, near, differs=differs, expected_area_px=area_px)
            nearest = min(blobs, key=lambda blob: math.dist(blob.center_px.tolist(), (x, y)), default=None)
            if nearest is None:
                continue
            is_there = True
            ratio = (self._size_px(nearest) / prior.size_px) ** 2
            if MIN_SCORE <= ratio <= _LARGER_BLOB:
                return ImageDetection(nearest, nearest.box_px, min(ratio, 1 / ratio)), True
        return None, is_there

    def start_from(self, state: CameraState, camera: CameraFrame, outline: Outline) -> CameraState:
        """The state with the target of an outline, behind which the background is unknown."""
        self.background.invalidate(camera.image, camera.view, outline.box_px)
        target = self.image_tracker.start(camera.image, outline.box_px, outline.angular_radius_rad)
        own = None if self.marker is None else colors_of(self.marker, camera.image, outline)
        return state._replace(target=target, marker=own)

    def _given(self, state: CameraState, outlines: list[Outline], prior: Prior) -> ImageDetection | None:
        """The outline of `outlines` that lies near the prior and has the predicted size."""
        half = 0.5 * prior.size_px + 2 * prior.std_px + 4
        expected_px = prior.size_px
        for outline in outlines:
            near = float(np.abs(outline.center_px - prior.center_px).max()) < half
            if near and abs(self._size_px(outline) / expected_px - 1) < SIZE_ERROR:
                return ImageDetection(outline, outline.box_px, 1.0)
        return None

    def remember(self, state: CameraState, camera: CameraFrame, outline: Outline, belief: Belief) -> CameraState:
        """Update the object's offset from the track and its size."""
        u, v, _, _ = camera.view.project_linearised(*_position_at(belief, camera.stamp_s))
        x, y = outline.center_px.tolist()
        return state._replace(offset_px=(x - u, y - v))

    def detection(self, camera: CameraFrame, detection: ImageDetection) -> Detection2D:
        """The message of an image detection."""
        outline = detection.outline
        return Detection2D(
            camera.stamp_s,
            self.name,
            outline.center_px,
            outline.cov_px,
            detection.score,
            outline.angular_radius_rad,
            detection.box_px,
        )

    def _size_px(self, outline: Outline) -> float:
        return 2 * outline.angular_radius_rad * self.optics.camera.focal_px


def _foreground(
    of_pixels: Callable[[Image, View, Box], NDArray[np.float32] | Mask],
    background: Background,
    camera: CameraFrame,
    box: Box,
) -> tuple[NDArray[np.float32], Mask]:
    """Difference from the background in a box (h, w), and where it is known."""
    differs = np.asarray(of_pixels(camera.image, camera.view, box), np.float32)
    return differs, background.knows(camera.view, box)


def _position_at(belief: Belief, stamp_s: float) -> Vector:
    """The object's position at the stamp of a camera's image, which may differ from the belief's."""
    (x, y, z), *rates = belief.mean.tolist()
    if not rates:
        return x, y, z
    dt = stamp_s - belief.stamp_s
    vx, vy, vz = rates[0]
    return x + vx * dt, y + vy * dt, z + vz * dt
