"""Tracker of one object in stereo images: detect → associate → predict → update → initiate or delete (R Fig 13)."""

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig, StereoView, reduced_image
from pps_vision.jit import njit
from pps_vision.types import Array, Detection2D, Observation3D, Status, StereoFrame, Track3D
from tracking import FollowedBy, Mode, frame_checks, kalman
from tracking.acquisition import Acquisition, Candidate, OwnBody, SearchCounts, Stages
from tracking.appearance import ColorModel, is_same_object
from tracking.camera_pose import CameraMotion, CameraPoses, PoseEstimator
from tracking.camera_tracker import CameraState, CameraTracker, Prior
from tracking.frame_checks import Fingerprints, Stamps
from tracking.image_tracker import Examined, ImageDetection
from tracking.kalman import Belief, KalmanParams
from tracking.marker import MarkerParams
from tracking.motion_trigger import TriggerParams
from tracking.optical_flow import velocity
from tracking.outline import Optics, Outline
from tracking.particle_filter import Located, ParticleFilterParams, Prediction, Silhouette, locate
from tracking.stereo import (
    Association,
    CameraFrames,
    Outlines,
    StereoParams,
    camera_frames,
    outline_shift_var,
    with_pose_error,
)

Appearance = MarkerParams | ColorModel
Detections = tuple[ImageDetection | None, ImageDetection | None]
_RADIUS_MEMORY = 30  # frames over which the radius is averaged
_WIDEST_PX = 40.0  # largest standard deviation of a search
_PIXELS = 0.5  # least standard deviation of a search, px
_GOOD = 1.6  # score of the particles below which a stop or turn is considered
_BETTER = 0.2  # by which its score must be better
_NOTHING: Detections = (None, None)
_NO_MODELS = (None, None)


@dataclass(frozen=True)
class TrackerParams:
    """Parameters of the tracker and of its parts."""

    mode: Mode = "generic"
    """Track any moving object, or a marker of known hue."""
    reduction: int = 1
    """Side of the pixel blocks that are averaged before tracking: larger takes less time, with more error."""
    confirm_frames: int = 3
    """An object is tracked once both cameras detected it in this many frames in a row."""
    lost_after_s: float = 0.5
    """A track that was not updated for this long is deleted."""
    aspect_rad: float = 0.6
    """Angle by which the line of sight turns until the correlated error of the position has changed by its standard
    deviation (chosen on 264 starts in simulation, seeds 6101 and 6102); inf: it stays."""
    stamp_error_s: float = 0.02
    """Prior standard deviation of the delay of the joints behind the images; 0: there is none."""
    background_memory_s: float = 0.3
    """What an eye at rest sees unchanged for this long becomes its background."""
    trigger: TriggerParams = field(default_factory=TriggerParams)
    """Motion trigger of each camera."""
    particles: ParticleFilterParams = field(default_factory=ParticleFilterParams)
    """Particle filter over whole objects."""
    marker: MarkerParams = field(default_factory=MarkerParams)
    """Colour of the marker."""
    stereo: StereoParams = field(default_factory=StereoParams)
    """Stereo association."""
    kalman: KalmanParams = field(default_factory=KalmanParams)
    """Kalman filter, for an object at 0.4 m."""

    def __post_init__(self) -> None:
        if self.mode not in ("generic", "marker"):
            raise InputError("tracker", f"mode {self.mode!r}; expected 'generic' or 'marker'")
        if self.reduction < 1:
            raise InputError("tracker", f"reduction {self.reduction}; expected 1 or more pixels")
        if not (self.stamp_error_s >= 0 and self.background_memory_s > 0):
            raise InputError(
                "tracker",
                f"delay of the joints ± {self.stamp_error_s} s, memory of the background {self.background_memory_s} s; "
                "expected 0 or more, and more than 0",
            )
        if not self.aspect_rad > 0:
            raise InputError("tracker", f"angle of another aspect {self.aspect_rad} rad; expected more than 0")
        if not (self.confirm_frames >= 1 and self.lost_after_s > 0):
            raise InputError(
                "tracker",
                f"confirm after {self.confirm_frames} frames, lost after {self.lost_after_s} s; expected more than 0",
            )


@dataclass(frozen=True, slots=True)
class TrackerStep:
    """Result of one frame: the track, the detections and the observation behind it, and the point (3,) midway between
    the cameras, m, root frame.

    `followed_by` is the cheapest that tells the object apart: its colours; where its surroundings have them too, what
    differs from the learned background of either eye; a marker's hue.  None while no object is followed.
    """

    track: Track3D
    detections: tuple[Detection2D, ...]
    observation: Observation3D | None
    midpoint_root: Array
    followed_by: FollowedBy | None = None


class TrackerState(NamedTuple):
    """State of the tracker, without the backgrounds, the cameras' motion and the images of the motion trigger."""

    association: Association
    kalman: KalmanParams  # scaled to the object's distance
    appearance: tuple[Appearance, Appearance] | None = None
    cameras: tuple[CameraState, CameraState] = (CameraState(), CameraState())
    belief: Belief | None = None
    search_result: tuple[Candidate, Candidate] | None = None  # candidates from which the object was acquired
    radius_m: float = math.nan
    radius_var_m2: float = math.nan
    hits: int = 0  # frames in which the object was observed
    whole_hits: int = 0  # of them, those in which it was wholly visible
    observed: Observation3D | None = None  # the last observation
    stamps_s: Stamps = (-math.inf, -math.inf)  # of the last frame, as are `images` and `view`
    images: Fingerprints | None = None
    view: StereoView | None = None


class Tracker:
    """Tracks one object in 3D.  `step` takes frames in the order of their stamps.

    `own_body` masks the robot's own body; `stages` is a context manager entered around each stage (to time it).
    """

    def __init__(
        self,
        params: TrackerParams,
        rig: StereoRig,
        rng: np.random.Generator,
        own_body: OwnBody | None = None,
        stages: Stages = lambda _: nullcontext(),
    ) -> None:
        self.params, self.rig, self.stages = params, rig, stages
        self.searched_rig = rig = rig if params.reduction == 1 else rig.reduced(params.reduction)
        self._optics = Optics(rig.left), Optics(rig.right)
        self._rng = rng
        marker = params.marker if params.mode == "marker" else None
        self._cameras = (
            CameraTracker("left", self._optics[0], marker, params.background_memory_s),
            CameraTracker("right", self._optics[1], marker, params.background_memory_s),
        )
        self.search_counts: SearchCounts = Counter()
        self._poses = PoseEstimator(rig, params.stamp_error_s)
        backgrounds = self._cameras[0].background, self._cameras[1].background
        self._acquisition = Acquisition(params.trigger, self._optics, backgrounds, own_body, stages, self.search_counts)
        untrained = Association.untrained(params.stereo, rig.left.width)
        self._initial = TrackerState(untrained, params.kalman, (marker, marker) if marker else None)
        self.state = self._initial

    @property
    def appearance(self) -> tuple[Appearance, Appearance] | None:
        """The marker's hue, or the object's colours when it was confirmed, in the left and the right eye; None while
        there is no object, or no colour."""
        return self.state.appearance

    @property
    def camera_motion(self) -> CameraMotion:
        """Error of the cameras' nominal poses at the last frame."""
        return self._poses.motion

    def step(self, frame: StereoFrame, outlines: tuple[Outlines, Outlines] = (None, None)) -> TrackerStep:
        """The track after this frame.

        Args:
            frame: The next stereo frame.
            outlines: The object's outlines in the left and the right (reduced) image, if they were computed beforehand
                (`batch`).

        Raises:
            InputError: A stamp that is not after the last one, or images or joints that are not the rig's; nothing
                has changed then.
        """
        frame_checks.check(frame, self.rig, self.state.stamps_s)
        self.state, result = self._advance(self.state, self.searched(frame), outlines)
        return result if self.params.reduction == 1 else _enlarged(result, self.params.reduction)

    def searched(self, frame: StereoFrame) -> StereoFrame:
        """The frame with reduced images."""
        k = self.params.reduction
        if k == 1:
            return frame
        return replace(frame, left=reduced_image(frame.left, k), right=reduced_image(frame.right, k))

    def _advance(
        self, state: TrackerState, frame: StereoFrame, outlines: tuple[Outlines, Outlines]
    ) -> tuple[TrackerState, TrackerStep]:
        """Detect, associate, update, initiate or delete."""
        images = frame_checks.fingerprints(frame)
        blind = frame_checks.is_blind(images, state.images)
        poses = self._poses.nominal(frame) if blind else self._poses.step(frame)
        view, blind = poses.view, blind or not poses.is_known
        cameras, stamp_s = camera_frames(frame, view, outlines), frame.stamp_s
        predicted = None if state.belief is None else kalman.predict(state.kalman, state.belief, stamp_s)
        was_tracked = predicted is not None and state.hits >= self.params.confirm_frames
        state, predicted, detections, located = self._detect(state, predicted, cameras, view, stamp_s, blind=blind)
        with self.stages("triangulation"):
            state, observation = self._associate(state, predicted, cameras, poses, stamp_s, detections, located)
        with self.stages("filter"):
            state, belief, updated = self._update(state, predicted, observation, view, stamp_s)
            measured = observation if updated else None
            state, track = self._manage(state, belief, measured, poses, stamp_s, located, blind=blind)
            if was_tracked and predicted is None and not track.is_known:  # dropped, or found elsewhere
                track = Track3D.unknown(stamp_s, Status.LOST)
        if not blind:
            state = self._learn(state, cameras, detections, observation)
        state = state._replace(stamps_s=(frame.stamp_left_s, frame.stamp_right_s), images=images, view=view)
        parts = zip(self._cameras, cameras, detections, strict=True)
        messages = tuple(
            tracker.detection(camera, detection) for tracker, camera, detection in parts if detection is not None
        )
        return state, TrackerStep(track, messages, observation, view.midpoint, self._followed_by(state))

    def _followed_by(self, state: TrackerState) -> FollowedBy | None:
        """`TrackerStep.followed_by`."""
        if state.belief is None:
            return None
        if self.params.mode == "marker":
            return "hue"
        return "background" if any(camera.by_background for camera in state.cameras) else "colour"

    def _detect(
        self,
        state: TrackerState,
        predicted: Belief | None,
        cameras: CameraFrames,
        view: StereoView,
        stamp_s: float,
        *,
        blind: bool,
    ) -> tuple[TrackerState, Belief | None, Detections, Located | None]:
        """The object in both images: near the prediction, else anywhere.

        If the object is re-acquired elsewhere, it must pass the re-identification gate; its motion state is reset and
        the track must be confirmed again.
        """
        if blind:
            return state, predicted, _NOTHING, None
        if predicted is None:
            state, detections = self._acquire(state, cameras, view, stamp_s)
            return state, None, detections, None
        with self.stages("image"):
            state, detections, located = self._follow(state, predicted, cameras)
        if None in detections and state.hits >= self.params.confirm_frames:
            acquired, elsewhere = self._acquire(state, cameras, view, stamp_s, predicted)
            if elsewhere[0] is not None:
                return acquired._replace(hits=0, whole_hits=0), None, elsewhere, None
        return state, predicted, detections, located

    def _follow(
        self, state: TrackerState, predicted: Belief, cameras: CameraFrames
    ) -> tuple[TrackerState, Detections, Located | None]:
        """The object near where the track predicts it: by quick means in each image, else by the particle filter; and
        where the particles are, if either image does not show the whole object."""
        last = state.belief or predicted
        search_cov = self._search_cov(predicted, cameras, np.zeros(3))
        dt_s = predicted.stamp_s - last.stamp_s
        wide_cov = self._search_cov(predicted, cameras, predicted.mean[0] - last.mean[0])
        wide_cov += (state.kalman.prior_std[0] * dt_s) ** 2 * np.eye(3)
        states = list(state.cameras)
        detections: list[ImageDetection | None] = [None, None]
        regions: dict[int, Examined] = {}
        priors: dict[int, Prior] = {}
        for k, (tracker, camera) in enumerate(zip(self._cameras, cameras, strict=True)):
            prior = tracker.predict(states[k], camera, predicted, wide_cov, state.radius_m)
            if prior is None:
                continue
            states[k], detections[k], may_be_there = tracker.quick(states[k], camera, prior)
            if may_be_there:
                states[k], region = tracker.examine(states[k], camera, prior)
                if region is not None:
                    regions[k] = region
                    priors[k] = tracker.predict(states[k], camera, predicted, search_cov, state.radius_m) or prior
        if not regions:
            return state._replace(cameras=(states[0], states[1])), (detections[0], detections[1]), None
        whole = {k: self._cameras[k].whole(states[k], cameras[k], region, priors[k]) for k, region in regions.items()}
        if all(whole.values()):
            for k, result in whole.items():
                if result is not None:
                    states[k], detections[k] = result
            return state._replace(cameras=(states[0], states[1])), (detections[0], detections[1]), None
        eyes = [
            self._cameras[k].eye(states[k], cameras[k], predicted, region.evidence) for k, region in regions.items()
        ]
        radius = state.radius_m, self.params.particles.radius_std[state.whole_hits >= self.params.confirm_frames]
        located = locate(self.params.particles, Prediction(predicted.mean[0], search_cov, *radius), eyes, self._rng)
        if located.score < _GOOD:  # the motion may have stopped or turned
            wide = Prediction(last.mean[0], wide_cov, *radius)
            elsewhere = locate(self.params.particles, wide, eyes, self._rng)
            located = elsewhere if elsewhere.score > located.score + _BETTER else located
        for eye, k in enumerate(regions):
            states[k], detections[k] = self._cameras[k].detect(states[k], cameras[k], regions[k], located, eye)
        state = state._replace(cameras=(states[0], states[1]))
        is_partial = any(detection is not None and detection.outline.is_partial for detection in detections)
        is_measured = is_partial and None not in detections and len(regions) == 2
        return state, (detections[0], detections[1]), located if is_measured else None

    def _search_cov(self, predicted: Belief, cameras: CameraFrames, shift: Array) -> Array:
        """(3, 3) m² within which the object is searched: of the prediction, an error of the pixels, and a `shift` (3,)
        m that a sudden stop or turn would take back."""
        p = predicted.mean[0]
        sight = p - 0.5 * (cameras[0].view.center + cameras[1].view.center)
        baseline_m = math.dist(cameras[0].view.place, cameras[1].view.place)
        distance_m = float(np.linalg.norm(sight))
        pixel_m = _PIXELS * distance_m / self.searched_rig.left.focal_px
        along = sight / distance_m
        cov = predicted.cov[:3, :3] + np.outer(shift, shift) + pixel_m**2 * np.eye(3)
        cov += (pixel_m * distance_m / baseline_m) ** 2 * np.outer(along, along)
        scale = min((_WIDEST_PX / _PIXELS * pixel_m) ** 2 / float(np.trace(cov)), 1.0)
        return np.asarray(scale * cov, float)

    def _acquire(
        self,
        state: TrackerState,
        cameras: CameraFrames,
        view: StereoView,
        stamp_s: float,
        predicted: Belief | None = None,
    ) -> tuple[TrackerState, Detections]:
        """Search both images for an object; with a `predicted` belief, only for the one that is tracked."""
        if self.params.mode == "marker":
            return self._acquire_marker(state, cameras, view, stamp_s, predicted)
        pair = self._acquisition.step(cameras, view, stamp_s, state.association)
        if pair is None:
            return state, _NOTHING
        outlines = pair[0].outline, pair[1].outline
        models = pair[0].model, pair[1].model
        if not self._passes_gate(state, predicted, view, outlines, stamp_s, models):
            return state, _NOTHING
        by_color = pair[0].by_color and pair[1].by_color
        observation = state.association.observe(view, *outlines, stamp_s)
        targets = []
        with self.stages("image"):
            for tracker, camera, candidate in zip(self._cameras, cameras, pair, strict=True):
                outline = candidate.outline
                if by_color:
                    tracker.background.invalidate(camera.image, camera.view, candidate.mask, candidate.box)
                box = _whole_box(outline) if outline.is_partial else outline.box_px
                seen = None
                if not outline.is_partial and not outline.is_disc and observation is not None:
                    shape = candidate.mask, candidate.box, camera.view, observation.p_root
                    seen = Silhouette(*shape, outline.center_px, observation.radius_m)
                targets.append(
                    tracker.image_tracker.start(camera.image, box, outline.angular_radius_rad, candidate.model, seen)
                )
        left, right = (
            camera_state._replace(target=target, by_background=not by_color)
            for camera_state, target in zip(state.cameras, targets, strict=True)
        )
        return state._replace(cameras=(left, right), search_result=pair), _detections(*outlines)

    def _acquire_marker(
        self, state: TrackerState, cameras: CameraFrames, view: StereoView, stamp_s: float, predicted: Belief | None
    ) -> tuple[TrackerState, Detections]:
        """As `_acquire`, a marker."""
        if state.view is None:  # whether anything has moved is known from the second frame on
            return state, _NOTHING
        with self.stages("image"):
            marker = self._acquisition.find_marker(self.params.marker, cameras, view, stamp_s, state.association)
        if marker is None or not self._passes_gate(state, predicted, view, marker, stamp_s, _NO_MODELS):
            return state, _NOTHING
        targets = []
        for tracker, camera, blob in zip(self._cameras, cameras, marker, strict=True):
            tracker.background.invalidate_box(camera.image, camera.view, blob.box_px)
            targets.append(tracker.image_tracker.start(camera.image, blob.box_px, blob.angular_radius_rad))
        pairs = zip(state.cameras, targets, strict=True)
        left, right = (camera_state._replace(target=target) for camera_state, target in pairs)
        return state._replace(cameras=(left, right)), _detections(*marker)

    def _passes_gate(
        self,
        state: TrackerState,
        predicted: Belief | None,
        view: StereoView,
        outlines: tuple[Outline, Outline],
        stamp_s: float,
        models: Sequence[ColorModel | None],
    ) -> bool:
        """Re-identification gate: same colours and size, and a plausible position; open while nothing is tracked."""
        if predicted is None:
            return True
        tracked_models = [camera.target.model if camera.target else None for camera in state.cameras]
        observation = state.association.observe(view, *outlines, stamp_s)
        if observation is None or not is_same_object(tracked_models, state.radius_m, models, observation.radius_m):
            return False
        measurement = observation.p_root, observation.cov_root, observation.correlated_cov_root
        return kalman.gate(state.kalman, predicted, *measurement) is not None

    def _associate(
        self,
        state: TrackerState,
        predicted: Belief | None,
        cameras: CameraFrames,
        poses: CameraPoses,
        stamp_s: float,
        detections: Detections,
        located: Located | None,
    ) -> tuple[TrackerState, Observation3D | None]:
        """Triangulate what both cameras detected, after learning the calibration's error from it.

        The first outline, grown from a motion region, is too rough to learn from.
        """
        left, right = detections
        if left is None or right is None:
            return state, None
        shift, view = None, poses.view
        if predicted is not None and len(predicted.mean) > 1 and cameras[0].stamp_s != cameras[1].stamp_s:
            p, v = predicted.mean[0], predicted.mean[1]
            shift_left, shift_right = (
                camera.view.project_jacobian(p) @ v * (stamp_s - camera.stamp_s) for camera in cameras
            )
            shift = shift_left, shift_right
        observation = state.association.observe(view, left.outline, right.outline, stamp_s, shift)
        if observation is None:
            return state, None
        if predicted is not None:
            learned = state.association.learned(poses.view, observation, left.outline, right.outline)
            state = state._replace(association=learned)
            observation = learned.observe(poses.view, left.outline, right.outline, stamp_s, shift) or observation
        if located is not None:
            observation = replace(
                observation, p_root=located.measured, cov_root=observation.cov_root + located.measured_cov
            )
        if poses.stamp_error_s > 0 and state.view is not None:
            dt_s = stamp_s - 0.5 * sum(state.stamps_s)
            observation = with_pose_error(observation, state.view, view, dt_s, poses.stamp_error_s)
        return state, observation

    def _update(
        self,
        state: TrackerState,
        predicted: Belief | None,
        observation: Observation3D | None,
        view: StereoView,
        stamp_s: float,
    ) -> tuple[TrackerState, Belief | None, bool]:
        """The belief after the observation, and whether it was taken in; the first observation starts the filter, at
        the velocity that the optical flow measured, if it did."""
        if observation is None:
            return state, predicted, False
        if predicted is not None:
            measurement = observation.p_root, observation.cov_root, observation.correlated_cov_root
            shift_var = outline_shift_var(state.observed, observation)
            belief = kalman.update(state.kalman, kalman.shifted(predicted, shift_var), *measurement)
            return state, belief, belief.rejections == 0
        params = kalman.scaled(self.params.kalman, math.dist(observation.p_root, view.midpoint))
        flows = (state.search_result[0].flow, state.search_result[1].flow) if state.search_result else (None, None)
        white_cov = observation.cov_root - observation.correlated_cov_root
        measured = velocity(flows, view, observation.p_root, params.prior_std[:2], white_cov) or (None, None)
        belief = kalman.start(
            *(params, stamp_s, observation.p_root, observation.cov_root, *measured, observation.correlated_cov_root)
        )
        return state._replace(kalman=params), belief, True

    def _manage(
        self,
        state: TrackerState,
        belief: Belief | None,
        observation: Observation3D | None,
        poses: CameraPoses,
        stamp_s: float,
        located: Located | None,
        *,
        blind: bool,
    ) -> tuple[TrackerState, Track3D]:
        """Confirm, coast or delete the track; a frame in which a camera is blind does not break a confirmation."""
        state = state._replace(belief=belief)
        if belief is None:
            return state, Track3D.unknown(stamp_s)
        confirmed = state.hits >= self.params.confirm_frames
        if observation is not None:
            state = state._replace(hits=state.hits + 1, observed=observation)
            if located is None or state.hits == 1:
                state = _with_radius(state, observation)
            elif state.whole_hits < self.params.confirm_frames:
                state = state._replace(radius_m=located.radius_m)
        elif state.observed is not None and stamp_s - state.observed.stamp_s > self.params.lost_after_s:
            return self._initial, Track3D.unknown(stamp_s, Status.LOST if confirmed else Status.SEARCHING)
        elif not confirmed and not blind:
            return self._initial, Track3D.unknown(stamp_s)
        if state.hits < self.params.confirm_frames:
            return state, Track3D.unknown(stamp_s)
        status = Status.COASTING if observation is None else Status.TRACKING
        ahead = belief.mean[0] - poses.view.midpoint
        angles = poses.rotation_std_rad, self.params.aspect_rad
        mean, cov = _full_state(belief.mean, belief.cov, belief.correlated_cov, ahead, *angles)
        return state, Track3D(stamp_s, mean, cov, state.radius_m, state.radius_var_m2, status)

    def _learn(
        self, state: TrackerState, cameras: CameraFrames, detections: Detections, observation: Observation3D | None
    ) -> TrackerState:
        """Update each camera's state, the object's colours once it is confirmed, and the backgrounds."""
        by_camera = list(zip(self._cameras, cameras, detections, strict=True))
        if self.params.mode == "generic" or state.belief is None:  # a marker needs it to be found
            for tracker, camera, detection in by_camera:
                tracker.background.update(
                    camera.image, camera.view, camera.stamp_s, detection.box_px if detection else None
                )
        if state.belief is None:
            return state
        belief = state.belief
        is_partial = any(detection is not None and detection.outline.is_partial for detection in detections)
        left, right = (
            tracker.remember(camera_state, camera, detection.outline, belief)
            if detection is not None and observation is not None and not is_partial
            else camera_state
            for (tracker, camera, detection), camera_state in zip(by_camera, state.cameras, strict=True)
        )
        appearance = state.appearance
        if appearance is None and state.hits >= self.params.confirm_frames and left.target and right.target:
            appearance = left.target.model, right.target.model
        return state._replace(cameras=(left, right), appearance=appearance)


def _enlarged(step: TrackerStep, k: int) -> TrackerStep:
    """The step of images reduced `k` times, in pixels of the original images."""
    detections = []
    for detection in step.detections:
        x, y, w, h = detection.box_px
        center_px, box_px = k * (detection.center_px + 0.5) - 0.5, (k * x, k * y, k * w, k * h)
        detections.append(replace(detection, center_px=center_px, cov_px=k**2 * detection.cov_px, box_px=box_px))
    observation = step.observation and replace(step.observation, residual_px=k * step.observation.residual_px)
    return replace(step, detections=tuple(detections), observation=observation)


def _whole_box(outline: Outline) -> tuple[float, float, float, float]:
    """Box of an object that the image's border cuts, extended beyond the border to a square."""
    x, y, w, h = outline.box_px
    side = max(w, h)
    left = x + w - side if x <= 0 else x
    top = y + h - side if y <= 0 else y
    return (left, y, side, h) if w < h else (x, top, w, side)


def _detections(left: Outline, right: Outline) -> Detections:
    """Detections from outlines of the search."""
    return ImageDetection(left, left.box_px, 1.0), ImageDetection(right, right.box_px, 1.0)


def _with_radius(state: TrackerState, observation: Observation3D) -> TrackerState:
    """The state with the radius averaged over the last frames; its error is correlated, so its variance is that of one
    frame."""
    whole_hits = state.whole_hits + 1
    radius = state.radius_m if state.whole_hits else observation.radius_m
    radius += (observation.radius_m - radius) / min(whole_hits, _RADIUS_MEMORY)
    return state._replace(radius_m=radius, radius_var_m2=observation.radius_var_m2, whole_hits=whole_hits)


@njit(cache=True, error_model="numpy")
def _full_state(
    mean: Array, cov: Array, correlated: Array, ahead: Array, error_rad: float, aspect_rad: float
) -> tuple[Array, Array]:
    """State (4, 3), zero where the filter does not model a derivative, and its covariance (12, 12).

    To the position's covariance comes the error that all measurements share: `correlated` (3, 3) m², and an angle
    `error_rad` across the line of sight to the object, `ahead` (3,) m of the cameras.  The velocity is that of the
    observed point, from which the object's differs by the rate of the correlated error: its standard deviation in the
    time in which the line of sight turns by `aspect_rad`.
    """
    whole, whole_cov = np.zeros((4, 3)), np.zeros((12, 12))
    for i in range(len(cov)):
        whole[i // 3, i % 3] = mean[i // 3, i % 3]
        for j in range(len(cov)):
            whole_cov[i, j] = cov[i, j]
    far2 = ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2]
    rate2 = 0.0  # 1/s²
    if len(mean) > 1:
        speed2 = mean[1, 0] ** 2 + mean[1, 1] ** 2 + mean[1, 2] ** 2
        along = mean[1, 0] * ahead[0] + mean[1, 1] * ahead[1] + mean[1, 2] * ahead[2]
        rate2 = (speed2 - along**2 / far2) / (far2 * aspect_rad**2)
    for i in range(3):
        for j in range(3):
            across = (far2 if i == j else 0.0) - ahead[i] * ahead[j]
            whole_cov[i, j] += correlated[i, j] + error_rad**2 * across
            whole_cov[3 + i, 3 + j] += rate2 * correlated[i, j]
    return whole, whole_cov
