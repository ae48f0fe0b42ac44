"""Tracker of one camera: predicts the object from the 3D track and detects it by its image or a marker's hue."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.geometry.compiled import Vector
from pps_vision.jit import njit
from pps_vision.types import Array, CameraName, Detection2D, Image, Mask
from tracking.ego_motion import Box
from tracking.foreground import Background, ForegroundParams
from tracking.image_tracker import (
    MIN_SCORE,
    Examined,
    ImageDetection,
    ImageTracker,
    SegmentedBy,
    Target,
)
from tracking.kalman import Belief
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Optics, Outline, at_visible_edge, fit_visible_edge
from tracking.particle_filter import Evidence, Eye, Located, Silhouette, template_of
from tracking.stereo import CameraFrame

_SEPARABLE = 0.8  # Bhattacharyya coefficient of object and surroundings up to which colours separate them
_BESIDE = 0.05  # largest distance of an outline from its prediction, in object sizes, added to three deviations
_MIN_INSIDE = 0.1  # least distance of the centre of a partly visible object from the border, in object sizes
MIN_FILL = 0.3  # visible share of the object below which it is not detected
_PARTICLE_PX = 0.3  # systematic error of the particles' centre
_MOST_SHIFT = 0.3  # of a visible edge from the particles, in radii
_SAME_SIZE = 0.03  # relative error of the predicted size of a wholly visible object
_LARGER_BLOB = 1.25  # ratio of a marker's areas in two images in a row above which its hue does not separate it
_MIN_STD_PX = 0.7  # smallest and largest standard deviation of a prior
_MAX_STD_PX = 40.0


class Prior(NamedTuple):  # constructing a frozen dataclass is three times slower
    """Predicted image: centre (2,) px with its standard deviation (px), distance (m), angular radius (rad), size."""

    center_px: Array
    std_px: float
    distance_m: float
    angle_rad: float
    size_px: float


class CameraState(NamedTuple):
    """State of one camera's tracker."""

    target: Target | None = None  # state of the image tracker; None before an object is acquired
    offset_px: tuple[float, float] = (0.0, 0.0)  # from the projected track to the outline's centre: calibration error
    by_background: bool = False  # whether the likelihood is the foreground, since colours do not separate the object


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
        std_px = min(max(_std_px(cov, of_u, of_v), _MIN_STD_PX), _MAX_STD_PX)
        return Prior(np.array(center), std_px, distance_m, angle_rad, size_px)

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
            if target.model.similarity(target.model.background) > _SEPARABLE:
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
        target, detection, mask = result
        off_px = math.dist(detection.outline.center_px.tolist(), prior.center_px.tolist())
        if off_px > 3 * prior.std_px + _BESIDE * prior.size_px:
            return None
        p_root = camera.view.center + prior.distance_m * camera.view.rays(detection.outline.center_px)
        radius_m = prior.distance_m * math.sin(prior.angle_rad)
        seen = self._seen(detection, mask, examined, camera, p_root, radius_m)
        return state._replace(target=replace(target, silhouette=seen)), detection

    @staticmethod
    def _seen(
        detection: ImageDetection, mask: Mask, examined: Examined, camera: CameraFrame, p_root: Array, radius_m: float
    ) -> Silhouette | None:
        """The silhouette of an object that is no ball."""
        outline = detection.outline
        if outline.is_disc:
            return None
        return Silhouette(mask, examined.roi, camera.view, p_root, outline.center_px, radius_m)

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
            target, detection, mask = whole
            seen = self._seen(detection, mask, examined, camera, located.p_root, located.radius_m)
            return state._replace(target=replace(target, silhouette=seen)), detection
        if self.marker is not None or min(located.fill) < MIN_FILL:  # a marker's occluder may have the same hue
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
            angular_radius_var=(_SAME_SIZE * angle) ** 2,
            box_px=(x - (w - 1) / 2, y - (h - 1) / 2, w, h),
            area_px=math.pi / 4 * w * h,
            is_partial=True,
        )
        radius_px = angle * self.optics.camera.focal_px
        region = examined.evidence.pixels, examined.covered, examined.roi
        fit = fit_visible_edge(camera.image, *region, *located.edges[eye], located.radius_std * radius_px)
        if fit is not None and math.hypot(*fit.shift_px) < _MOST_SHIFT * radius_px:
            outline = at_visible_edge(outline, fit, radius_px)
        return ImageDetection(outline, outline.box_px, located.fill[eye])

    def _known_background(self, camera: CameraFrame) -> Background | None:
        """The background; None if unknown, or for a marker if the camera moves."""
        rests = self.background.rests(camera.view)
        return self.background if rests or (self.background.is_known and self.marker is None) else None

    def _find_marker(
        self, marker: MarkerParams, state: CameraState, camera: CameraFrame, prior: Prior
    ) -> tuple[ImageDetection | None, bool]:
        """The blob nearest to the prior, None if its area does not fit (then its hue does not separate it); and whether
        there is any blob."""
        x, y = prior.center_px.tolist()
        near = (x, y, prior.size_px + 4 * prior.std_px + 3)
        area_px = math.pi / 4 * prior.size_px**2
        rests = self.background.rests(camera.view)
        differs = partial(self.background.differs, camera.image, camera.view) if rests else None
        blobs = find_markers(marker, camera.image, self.optics, near, differs=differs, expected_area_px=area_px)
        nearest = min(blobs, key=lambda blob: math.dist(blob.center_px.tolist(), (x, y)), default=None)
        if nearest is None:
            return None, False
        ratio = (self._size_px(nearest) / prior.size_px) ** 2
        if not MIN_SCORE <= ratio <= _LARGER_BLOB:
            return None, True
        return ImageDetection(nearest, nearest.box_px, min(ratio, 1 / ratio)), True

    def _given(self, state: CameraState, outlines: list[Outline], prior: Prior) -> ImageDetection | None:
        """The outline of `outlines` that lies near the prior and has the predicted size."""
        half = 0.5 * prior.size_px + 2 * prior.std_px + 4
        expected_px = prior.size_px
        for outline in outlines:
            near = float(np.abs(outline.center_px - prior.center_px).max()) < half
            if near and abs(self._size_px(outline) / expected_px - 1) < _SAME_SIZE:
                return ImageDetection(outline, outline.box_px, 1.0)
        return None

    def remember(self, state: CameraState, camera: CameraFrame, outline: Outline, belief: Belief) -> CameraState:
        """Update the object's offset from the track and its size."""
        u, v, _, _ = camera.view.project_linearised(*_position_at(belief, camera.stamp_s))
        x, y = outline.center_px.tolist()
        return state._replace(offset_px=(x - u, y - v))

    def detection(self, camera: CameraFrame, detection: ImageDetection) -> Detection2D:
        """The message of an image detection."""
        shape = detection.outline
        return Detection2D(
            camera.stamp_s,
            self.name,
            shape.center_px,
            shape.cov_px,
            detection.score,
            shape.angular_radius_rad,
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
    """What differs from the background in a box (h, w), and where that is known."""
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


@njit(cache=True, error_model="numpy")
def _std_px(cov: Array, of_u: Vector, of_v: Vector) -> float:
    """Standard deviation (px) of the image of a point: `cov`'s first three rows and columns are its covariance (m²),
    `of_u` and `of_v` the derivatives of the pixel by it (px/m)."""
    var = 0.0
    for i in range(3):
        for j in range(3):
            var += cov[i, j] * (of_u[i] * of_u[j] + of_v[i] * of_v[j])
    return math.sqrt(var)
