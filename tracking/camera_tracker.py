"""Tracker of one camera: predicts the object from the 3D track and detects it by its image or a marker's hue."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from pps_vision.geometry.compiled import Vector
from pps_vision.jit import njit
from pps_vision.types import Array, CameraName, Detection2D
from tracking.background import Background
from tracking.ego_motion import EgoMotion
from tracking.image_tracker import MIN_SCORE, ImageDetection, ImageTracker, ImageTrackerParams, Target
from tracking.kalman import Belief
from tracking.marker import MarkerParams, find_markers
from tracking.moving_background import MovingBackground
from tracking.outline import Optics, Outline
from tracking.particle_filter import Prior
from tracking.stereo import CameraFrame

_SEPARABLE = 0.8  # Bhattacharyya coefficient of object and surroundings up to which colours separate them
_WIDE_SEARCH = 1.2  # standard deviation of a wide prior, relative to the object's size
_SAME_SIZE = 0.03  # relative error of the predicted size of a wholly visible object
_LARGER_BLOB = 1.25  # ratio of a marker's areas in two images in a row above which its hue does not separate it
_MIN_STD_PX = 0.7  # smallest and largest standard deviation of a prior
_MAX_STD_PX = 40.0


class CameraState(NamedTuple):
    """State of one camera's tracker."""

    target: Target | None = None  # state of the image tracker; None before an object is acquired
    offset_px: tuple[float, float] = (0.0, 0.0)  # from the projected track to the outline's centre: calibration error
    size_px: float = 0.0  # apparent diameter
    by_background: bool = False  # whether the likelihood is the foreground, since colours do not separate the object


class CameraTracker:
    """Tracker of one camera. Holds no state but the background."""

    def __init__(
        self,
        name: CameraName,
        optics: Optics,
        params: ImageTrackerParams,
        marker: MarkerParams | None,
        background_memory_s: float,
        rng: np.random.Generator,
    ) -> None:
        self.name = name
        self.optics = optics
        self.marker = marker
        self.image_tracker = ImageTracker(params, optics, rng)
        self.background = Background(EgoMotion(optics.camera), background_memory_s)

    def predict(self, state: CameraState, camera: CameraFrame, last: Belief, predicted: Belief) -> Prior | None:
        """Predicted position in this camera's image; None outside of it."""
        x, y, z = _position_at(predicted, camera.stamp_s)
        u, v, of_u, of_v = camera.view.project_linearised(x, y, z)
        center = (u + state.offset_px[0], v + state.offset_px[1])
        if not self.optics.camera.contains(center, margin_px=-0.5 * state.size_px):
            return None
        eye = camera.view.place
        growth = math.dist(last.mean[0].tolist(), eye) / math.dist((x, y, z), eye)
        std_px = min(max(_std_px(predicted.cov, of_u, of_v), _MIN_STD_PX), _MAX_STD_PX)
        return Prior(np.array(center), std_px, min(max(growth, 0.8), 1.25))

    def find(
        self, state: CameraState, camera: CameraFrame, prior: Prior | None
    ) -> tuple[CameraState, ImageDetection | None]:
        """The object near its prior, from `camera.outlines` (`batch`) or by a search; None where it is not detected."""
        if prior is None:
            return state, None
        detection = None if state.by_background else self._given(state, camera.outlines or [], prior)
        if detection is None and self.marker is not None:
            detection, is_hue_there = self._find_marker(self.marker, state, camera, prior)
            if detection is None and not is_hue_there:
                return state, None
        if detection is not None:
            target = state.target and self.image_tracker.follow(state.target, detection.outline)
            return state._replace(target=target), detection
        if state.target is None:
            return state, None
        previous = state.target
        background = self._known_background(camera)
        different = None
        if background is not None:
            of_pixels = background.evidence if state.by_background else background.differs
            different = partial(of_pixels, camera.image, camera.view)
        elif state.by_background:  # only colours are left
            if previous.model.similarity(previous.model.background) > _SEPARABLE:
                return state, None
            state = state._replace(by_background=False)
        # in front of a moving camera, colours alone are more accurate where they separate the object
        evidence = different if state.by_background or background is self.background else None
        search = partial(self.image_tracker.step, previous, camera.image, by_color=not state.by_background)
        target, detection = search(prior, evidence, if_joined=different)
        if detection is None and evidence is None and different is not None:
            evidence = different
            target, detection = search(prior, evidence)
        if detection is None and evidence is not None and not previous.touched:  # the motion may have reversed
            last_px = previous.particles.current[:, :2].mean(axis=0)
            target, detection = search(Prior(last_px, _WIDE_SEARCH * previous.size, prior.growth), evidence)
        if self.marker is not None and detection is not None and detection.outline.is_partial:
            return state, None  # the occluder may have the same hue
        return state._replace(target=target), detection

    def _known_background(self, camera: CameraFrame) -> Background | MovingBackground | None:
        """The background of the static or moving camera; None if unknown, or for a marker if the camera moves."""
        if self.background.is_known(camera.view):
            return self.background
        return None if self.marker else self.background.behind_moving_eye(camera.view, camera.stamp_s)

    def _find_marker(
        self, marker: MarkerParams, state: CameraState, camera: CameraFrame, prior: Prior
    ) -> tuple[ImageDetection | None, bool]:
        """The blob nearest to the prior, None if its area does not fit (then its hue does not separate it); and whether
        there is any blob."""
        x, y = prior.center_px.tolist()
        near = (x, y, state.size_px + 4 * prior.std_px + 3)
        area_px = math.pi / 4 * (prior.growth * state.size_px) ** 2
        differs = partial(self.background.differs, camera.image, camera.view)
        blobs = find_markers(marker, camera.image, self.optics, near, differs=differs, expected_area_px=area_px)
        nearest = min(blobs, key=lambda blob: math.dist(blob.center_px.tolist(), (x, y)), default=None)
        if nearest is None:
            return None, False
        ratio = (self._size_px(nearest) / (prior.growth * state.size_px)) ** 2
        if not MIN_SCORE <= ratio <= _LARGER_BLOB:
            return None, True
        return ImageDetection(nearest, nearest.box_px, min(ratio, 1 / ratio)), True

    def _given(self, state: CameraState, outlines: list[Outline], prior: Prior) -> ImageDetection | None:
        """The outline of `outlines` that lies near the prior and has the predicted size."""
        half = 0.5 * state.size_px + 2 * prior.std_px + 4
        expected_px = prior.growth * state.size_px
        for outline in outlines:
            near = float(np.abs(outline.center_px - prior.center_px).max()) < half
            if near and abs(self._size_px(outline) / expected_px - 1) < _SAME_SIZE:
                return ImageDetection(outline, outline.box_px, 1.0)
        return None

    def remember(self, state: CameraState, camera: CameraFrame, outline: Outline, belief: Belief) -> CameraState:
        """Update the object's offset from the track and its size."""
        u, v, _, _ = camera.view.project_linearised(*_position_at(belief, camera.stamp_s))
        x, y = outline.center_px.tolist()
        return state._replace(offset_px=(x - u, y - v), size_px=self._size_px(outline))

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
