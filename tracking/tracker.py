"""Tracker of objects in stereo images: detect → associate → predict → update → initiate or delete (R Fig 13)."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig, StereoView, reduced_image, sight
from pps_vision.geometry.masks import BoxPx
from pps_vision.jit import njit
from pps_vision.types import Array, Detection2D, Observation3D, Status, StereoFrame, Track3D
from tracking import FollowedBy, Mode, frame_checks, kalman
from tracking.acquisition import Acquisition, Candidate, FollowedBoxes, SearchCounts, Stages
from tracking.appearance import ColorModel, is_same_object
from tracking.camera_pose import CameraMotion, CameraPoses, OwnBody, PoseEstimator
from tracking.foreground import ForegroundParams
from tracking.frame_checks import Fingerprints, Stamps
from tracking.image_tracker import SIZE_FRAMES, CameraState, CameraTracker, Examined, ImageDetection, Prior
from tracking.kalman import Belief, KalmanParams
from tracking.marker import MarkerParams
from tracking.motion_trigger import TriggerParams
from tracking.outline import Optics, Outline, outline_in_box
from tracking.particle_filter import Located, ParticleFilterParams, Prediction, Silhouette, locate
from tracking.stereo import (
    Association,
    CameraFrames,
    Outlines,
    StereoParams,
    camera_frames,
    shift_cov,
    with_pose_error,
    with_velocity_error,
)

Appearance = MarkerParams | ColorModel
Detections = tuple[ImageDetection | None, ImageDetection | None]
_RADIUS_MEMORY = 30  # frames over which the radius is averaged
_WIDEST_PX = 40.0  # largest standard deviation of a search
_PIXELS = 0.5  # least standard deviation of a search, px
_WHOLE_SCORE = 2.0  # of particles at an object that is wholly visible
_WORSE = 0.2  # loss of the particles' score from which a stop or turn is considered, which must be as much better
_PART_RATIO_STD = 0.01  # relative error of the angular radius of a disc that is partly hidden
_SEARCH_EVERY = 2  # frames between searches for further objects
_CLEARLY = 1.4  # ratio of times to contact, or of distances, from which another object is attended
_NO_MODELS = (None, None)


@dataclass(frozen=True)
class TrackerParams:
    """Parameters of the tracker and of its parts."""

    mode: Mode = "generic"
    """Track any moving object, or a marker of known hue."""
    reduction: int = 1
    """Side of the pixel blocks that are averaged before tracking: larger takes less time, with more error."""
    initial_boxes: tuple[BoxPx, BoxPx] | None = None
    """Boxes of the object in the first left and right image, which it is followed from, unless it is searched for."""
    max_objects: int = 1
    """Largest number of objects that are followed at a time; of markers, one."""
    confirm_frames: int = 3
    """An object is tracked once both cameras detected it in this many frames in a row."""
    lost_after_s: float = 0.5
    """A track that was not updated for this long is deleted."""
    aspect_rad: float = 0.6
    """Angle by which the line of sight turns until the correlated error of the position has changed by its standard
    deviation (chosen on 264 starts in simulation, seeds 6101 and 6102); inf: it stays."""
    stamp_error_s: float = 0.02
    """Prior standard deviation of the delay of the joints behind the images; 0: there is none."""
    trigger: TriggerParams = field(default_factory=TriggerParams)
    """Motion trigger of each camera."""
    foreground: ForegroundParams = field(default_factory=ForegroundParams)
    """Background and foreground of each camera."""
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
        if not self.stamp_error_s >= 0:
            raise InputError("tracker", f"delay of the joints ± {self.stamp_error_s} s; expected 0 or more")
        if not self.aspect_rad > 0:
            raise InputError("tracker", f"angle of another aspect {self.aspect_rad} rad; expected more than 0")
        if self.max_objects < 1:
            raise InputError("tracker", f"{self.max_objects} objects; expected 1 or more")
        if not (self.confirm_frames >= 1 and self.lost_after_s > 0):
            raise InputError(
                "tracker",
                f"confirm after {self.confirm_frames} frames, lost after {self.lost_after_s} s; expected more than 0",
            )


@dataclass(frozen=True, slots=True)
class TrackerStep:
    """Result of one frame for one object: its track, the detections and the observation behind it, and where the
    cameras are, (2, 3) m.

    `followed_by` is the cheapest that tells the object apart: its colours; where its surroundings have them too, what
    differs from the learned background of either eye; a marker's hue.  None while no object is followed.

    A tracker's step is the attended object's; `others` are the other objects' steps, oldest first.
    """

    track: Track3D
    detections: tuple[Detection2D, ...]
    observation: Observation3D | None
    centers_root: Array
    followed_by: FollowedBy | None = None
    others: tuple["TrackerStep", ...] = ()

    @property
    def tracks(self) -> tuple[Track3D, ...]:
        """Tracks of all objects, that of the attended one first."""
        return self.track, *(other.track for other in self.others)


class TrackState(NamedTuple):
    """State of one object's track."""

    association: Association
    kalman: KalmanParams  # scaled to the object's distance
    track_id: int = 0
    appearance: tuple[Appearance, Appearance] | None = None
    cameras: tuple[CameraState, CameraState] = (CameraState(), CameraState())
    belief: Belief | None = None
    radius_m: float = math.nan
    radius_var_m2: float = math.nan
    hits: int = 0  # frames in which the object was observed
    whole_hits: int = 0  # those in which it was wholly visible
    observed: Observation3D | None = None  # the last observation
    score: float = _WHOLE_SCORE  # the particles' score in the last frame


class TrackerState(NamedTuple):
    """State of the tracker, without the backgrounds, the cameras' motion and the images of the motion trigger."""

    tracks: tuple[TrackState, ...] = ()
    attended_id: int | None = None
    last_id: int = 0  # number of the newest track
    frames: int = 0
    stamps_s: Stamps = (-math.inf, -math.inf)  # stamps of the last frame, as are `images` and `view`
    images: Fingerprints | None = None
    view: StereoView | None = None


class _Scene(NamedTuple):
    """Content of one frame: both cameras, their poses, the mean stamp, and the view and the stamp of the last frame."""

    cameras: CameraFrames
    poses: CameraPoses
    stamp_s: float
    last_view: StereoView | None
    last_stamp_s: float
    is_blind: bool

    @property
    def view(self) -> StereoView:
        return self.poses.view


class _Followed(NamedTuple):
    """A track with its prediction (None: it starts) and its detections, and where the particles are, if either image
    does not show the whole object; whether it was tracked before it started elsewhere."""

    track: TrackState
    predicted: Belief | None
    detections: Detections = (None, None)
    located: Located | None = None
    was_tracked: bool = False


class Tracker:
    """Tracks objects in 3D.  `step` takes frames in the order of their stamps.

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
            CameraTracker("left", self._optics[0], marker, params.foreground),
            CameraTracker("right", self._optics[1], marker, params.foreground),
        )
        self.search_counts: SearchCounts = Counter()
        self._poses = PoseEstimator(rig, params.stamp_error_s, own_body)
        backgrounds = self._cameras[0].background, self._cameras[1].background
        self._acquisition = Acquisition(params.trigger, self._optics, backgrounds, own_body, stages, self.search_counts)
        untrained = Association.untrained(params.stereo, rig.left.width)
        self._initial = TrackState(untrained, params.kalman, appearance=(marker, marker) if marker else None)
        self._max_objects = 1 if marker else params.max_objects
        self.state = TrackerState()

    @property
    def appearance(self) -> tuple[Appearance, Appearance] | None:
        """The marker's hue, or the attended object's colours when it was confirmed, in the left and the right eye; None
        while there is no object, or no colour."""
        tracks = {track.track_id: track for track in self.state.tracks}
        attended = self.state.attended_id
        return (self._initial if attended is None else tracks.get(attended, self._initial)).appearance

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
        is_blind = frame_checks.is_blind(images, state.images)
        poses = self._poses.nominal(frame) if is_blind else self._poses.step(frame)
        cameras = camera_frames(frame, poses.view, outlines)
        last_stamp_s = 0.5 * sum(state.stamps_s)
        scene = _Scene(cameras, poses, frame.stamp_s, state.view, last_stamp_s, is_blind or not poses.is_known)
        followed = [self._detect(track, scene) for track in state.tracks]
        if not scene.is_blind:
            followed, last_id = self._search(state, followed, scene)
            state = state._replace(last_id=last_id)
        results = [self._track(item, scene) for item in followed]
        if not scene.is_blind:
            self._learn_backgrounds(results, cameras)
        tracks = tuple(track for track, _, _ in results if track.belief is not None)
        steps = [step for _, step, _ in results]
        attended = self._attended(state.attended_id, steps)
        stamps_s = frame.stamp_left_s, frame.stamp_right_s
        attended_id = None if attended is None else attended.track.track_id
        state = TrackerState(tracks, attended_id, state.last_id, state.frames + 1, stamps_s, images, poses.view)
        if attended is None:
            return state, TrackerStep(Track3D.unknown(frame.stamp_s), (), None, poses.view.centers)
        return state, replace(attended, others=tuple(step for step in steps if step is not attended))

    def _track(self, item: _Followed, scene: _Scene) -> tuple[TrackState, TrackerStep, Detections]:
        """Associate the detections of one object, update its track, confirm or delete it, and learn from it."""
        track, predicted, detections, located, was_tracked = item
        was_tracked |= predicted is not None and track.hits >= self.params.confirm_frames
        with self.stages("triangulation"):
            track, observation = self._associate(track, predicted, scene, detections, located)
        with self.stages("filter"):
            track, belief, updated = self._update(track, predicted, observation, scene)
            measured = observation if updated else None
            track, result = self._manage(track, belief, measured, scene, located)
            if was_tracked and predicted is None and not result.is_known:  # dropped, or found elsewhere
                result = Track3D.unknown(scene.stamp_s, Status.LOST, track.track_id)
        if not scene.is_blind and track.belief is not None:
            track = self._learn(track, scene.cameras, detections, observation)
        parts = zip(self._cameras, scene.cameras, detections, strict=True)
        messages = tuple(
            tracker.detection(camera, detection) for tracker, camera, detection in parts if detection is not None
        )
        step = TrackerStep(result, messages, observation, scene.view.centers, self._followed_by(track))
        return track, step, detections

    def _followed_by(self, track: TrackState) -> FollowedBy | None:
        """`TrackerStep.followed_by`."""
        if track.belief is None:
            return None
        if self.params.mode == "marker":
            return "hue"
        return "background" if any(camera.by_background for camera in track.cameras) else "colour"

    def _attended(self, last_id: int | None, steps: Sequence[TrackerStep]) -> TrackerStep | None:
        """The step of the object that is attended: the one with the smallest time to contact with the cameras, else the
        nearest that moves; the last one, unless another is clearly sooner or nearer."""
        if len(steps) < 2:
            return steps[0] if steps else None
        known = [step for step in steps if step.track.is_known]
        last = next((step for step in steps if step.track.track_id == last_id), None)
        if not known:
            return last or steps[0]
        urgencies = [_urgency(step) for step in known]
        best = max(range(len(known)), key=urgencies.__getitem__)
        if last is None or not last.track.is_known:
            return known[best]
        (last_sooner, last_nearer), (sooner, nearer) = _urgency(last), urgencies[best]
        is_clear = sooner > _CLEARLY * last_sooner or (last_sooner == 0 and nearer > _CLEARLY * last_nearer)
        return known[best] if is_clear else last

    def _detect(self, track: TrackState, scene: _Scene) -> _Followed:
        """The object near where the track predicts it."""
        predicted = None if track.belief is None else kalman.predict(track.kalman, track.belief, scene.stamp_s)
        if scene.is_blind or predicted is None:
            return _Followed(track, predicted)
        with self.stages("image"):
            track, detections, located = self._follow(track, predicted, scene.cameras)
        return _Followed(track, predicted, detections, located)

    def _search(self, state: TrackerState, followed: list[_Followed], scene: _Scene) -> tuple[list[_Followed], int]:
        """Search for objects: in every frame while none is followed or one is out of sight, else in every second one.

        If an object is re-acquired elsewhere, it must pass the re-identification gate; its motion state is reset and
        the track must be confirmed again.
        """
        kept = [
            item for item in followed if None not in item.detections or item.track.hits >= self.params.confirm_frames
        ]
        awaited = [item for item in kept if None in item.detections]
        has_room = len(kept) < self._max_objects
        boxes = self._followed_boxes(followed)
        if not (awaited or not followed or (has_room and state.frames % _SEARCH_EVERY == 0)):
            if self._max_objects > 1:
                self._acquisition.remember(scene.cameras, boxes)
            return followed, state.last_id
        acquired = self._acquire(state, scene, boxes)
        if acquired is None:
            return followed, state.last_id
        start, outlines, models = acquired
        for item in awaited:
            if self._passes_gate(item, scene, outlines, models):
                again = start(item.track)._replace(hits=0, whole_hits=0)
                restarted = _Followed(again, None, _detections(*outlines), was_tracked=True)
                return [restarted if other is item else other for other in followed], state.last_id
        is_cut = kept and any(outline.is_cut for outline in outlines)  # such as an arm that reaches into the image
        if is_cut or not has_room or any(self._overlaps(item, scene, outlines) for item in kept):
            return followed, state.last_id
        track = start(self._initial)._replace(track_id=state.last_id + 1)
        return [*followed, _Followed(track, None, _detections(*outlines))], state.last_id + 1

    @staticmethod
    def _followed_boxes(followed: Sequence[_Followed]) -> FollowedBoxes:
        """Boxes of the detected objects in both images."""
        left, right = (
            [detection.box_px for item in followed if (detection := item.detections[k]) is not None] for k in (0, 1)
        )
        return left, right

    def _overlaps(self, item: _Followed, scene: _Scene, outlines: tuple[Outline, Outline]) -> bool:
        """Whether outlines lie where a track predicts its object in either image."""
        if item.predicted is None:
            return False
        for tracker, camera, outline in zip(self._cameras, scene.cameras, outlines, strict=True):
            reach_px = 0.5 * outline.angular_radius_rad * tracker.optics.camera.focal_px
            pixel = camera.view.project(item.predicted.mean[0])
            size_px = item.track.radius_m / math.dist(item.predicted.mean[0], camera.view.place)
            reach_px += size_px * tracker.optics.camera.focal_px
            if math.dist(pixel.tolist(), outline.center_px.tolist()) < reach_px:
                return True
        return False

    def _follow(
        self, state: TrackState, predicted: Belief, cameras: CameraFrames
    ) -> tuple[TrackState, Detections, Located | None]:
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
                    priors[k] = prior.within(search_cov)
        if not regions:
            return state._replace(cameras=(states[0], states[1])), (detections[0], detections[1]), None
        whole = {k: self._cameras[k].whole(states[k], cameras[k], region, priors[k]) for k, region in regions.items()}
        if all(whole.values()):
            for k, result in whole.items():
                if result is not None:
                    states[k], detections[k] = result
            state = state._replace(cameras=(states[0], states[1]), score=_WHOLE_SCORE)
            return state, (detections[0], detections[1]), None
        silhouettes = [result[0].target.silhouette for result in whole.values() if result and result[0].target]
        silhouette = next(iter(silhouettes), None)
        for k in regions:
            target = states[k].target
            if whole[k] is None and target and target.silhouette and silhouette:  # the other eye's is newer
                states[k] = states[k]._replace(target=replace(target, silhouette=silhouette))
        eyes = [
            self._cameras[k].eye(states[k], cameras[k], predicted, region.evidence) for k, region in regions.items()
        ]
        radius = state.radius_m, self.params.particles.radius_std[state.whole_hits >= self.params.confirm_frames]
        located = locate(self.params.particles, Prediction(predicted.mean[0], search_cov, *radius), eyes, self._rng)
        if located.score < state.score - _WORSE:  # the motion may have stopped or turned
            wide = Prediction(last.mean[0], wide_cov, *radius)
            elsewhere = locate(self.params.particles, wide, eyes, self._rng)
            located = elsewhere if elsewhere.score > located.score + _WORSE else located
        for eye, k in enumerate(regions):
            states[k], detections[k] = self._cameras[k].detect(states[k], cameras[k], regions[k], located, eye)
        state = state._replace(cameras=(states[0], states[1]), score=located.score)
        without_edge = [d is not None and d.outline.is_partial and not d.outline.is_edge for d in detections]
        is_measured = any(without_edge) and None not in detections and len(regions) == 2
        return state, (detections[0], detections[1]), located if is_measured else None

    def _search_cov(self, predicted: Belief, cameras: CameraFrames, shift: Array) -> Array:
        """(3, 3) m² within which the object is searched: of the prediction, an error of the pixels, and a `shift` (3,)
        m that a sudden stop or turn would take back."""
        centers = np.stack([camera.view.center for camera in cameras])
        return _search_cov(centers, predicted.mean[0], predicted.cov, shift, self.searched_rig.left.focal_px)

    def _acquire(
        self, state: TrackerState, scene: _Scene, followed: FollowedBoxes
    ) -> tuple[Callable[[TrackState], TrackState], tuple[Outline, Outline], tuple[ColorModel | None, ...]] | None:
        """Search both images for an object: what starts its track, its outlines and its colours."""
        association = state.tracks[0].association if state.tracks else self._initial.association
        cameras = scene.cameras
        if self.params.initial_boxes is not None and state.view is None:
            left, right = (
                outline_in_box(camera.image, [side / self.params.reduction for side in box], optics)
                for camera, box, optics in zip(cameras, self.params.initial_boxes, self._optics, strict=True)
            )
            return partial(self._start_from, cameras, (left, right)), (left, right), _NO_MODELS
        if self.params.mode == "marker":
            if state.view is None:  # whether anything has moved is known from the second frame on
                return None
            with self.stages("image"):
                blobs = self._acquisition.find_marker(self.params.marker, cameras, scene.view, association)
            return None if blobs is None else (partial(self._start_from, cameras, blobs), blobs, _NO_MODELS)
        pair = self._acquisition.step(cameras, scene.view, association, followed)
        if pair is None:
            return None
        outlines = pair[0].outline, pair[1].outline
        observation = association.observe(scene.view, *outlines, scene.stamp_s)
        return partial(self._start, cameras, pair, observation), outlines, (pair[0].model, pair[1].model)

    def _start(
        self,
        cameras: CameraFrames,
        pair: tuple[Candidate, Candidate],
        observation: Observation3D | None,
        track: TrackState,
    ) -> TrackState:
        """The track with the targets of a pair of candidates."""
        by_color = pair[0].by_color and pair[1].by_color
        targets = []
        with self.stages("image"):
            for tracker, camera, candidate in zip(self._cameras, cameras, pair, strict=True):
                outline = candidate.outline
                if by_color:
                    place = camera.image, camera.view, candidate.mask, candidate.box
                    tracker.background.invalidate_mask(*place, candidate.model.shows)
                silhouette = candidate.silhouette
                if silhouette is None and not outline.is_partial and not outline.is_disc:
                    silhouette = candidate.mask, candidate.box
                box = _whole_box(outline) if outline.is_partial and silhouette is None else outline.box_px
                seen = None
                if silhouette is not None and observation is not None:
                    mask, region = silhouette
                    p_root, radius_m = observation.p_root, observation.radius_m
                    seen = Silhouette(mask, region, camera.view, p_root, outline.center_px, radius_m)
                appearance = outline.angular_radius_rad, candidate.model, seen
                target = tracker.image_tracker.start(camera.image, box, *appearance)
                if candidate.is_part:  # a disc of known size, partly hidden
                    target = replace(target, ratio_std=_PART_RATIO_STD, frames=SIZE_FRAMES)
                targets.append(target)
        left, right = (
            camera_state._replace(target=target, by_background=not by_color)
            for camera_state, target in zip(track.cameras, targets, strict=True)
        )
        return track._replace(cameras=(left, right))

    def _start_from(self, cameras: CameraFrames, outlines: tuple[Outline, Outline], track: TrackState) -> TrackState:
        """The track with the targets of a marker's blobs, or of outlines in given boxes."""
        left, right = (
            tracker.start_from(state, camera, outline)
            for tracker, state, camera, outline in zip(self._cameras, track.cameras, cameras, outlines, strict=True)
        )
        own = (left.marker, right.marker) if left.marker and right.marker else track.appearance
        return track._replace(cameras=(left, right), appearance=own)

    def _passes_gate(
        self,
        item: _Followed,
        scene: _Scene,
        outlines: tuple[Outline, Outline],
        models: Sequence[ColorModel | None],
    ) -> bool:
        """Re-identification gate: same colours and size, and a plausible position."""
        track = item.track
        predicted = item.predicted
        tracked_models = [camera.target.model if camera.target else None for camera in track.cameras]
        observation = track.association.observe(scene.view, *outlines, scene.stamp_s)
        if predicted is None or observation is None:
            return False
        if not is_same_object(tracked_models, track.radius_m, models, observation.radius_m):
            return False
        measurement = observation.p_root, observation.cov_root, observation.correlated_cov_root
        return kalman.gate(track.kalman, predicted, *measurement) is not None

    def _associate(
        self,
        state: TrackState,
        predicted: Belief | None,
        scene: _Scene,
        detections: Detections,
        located: Located | None,
    ) -> tuple[TrackState, Observation3D | None]:
        """Triangulate what both cameras detected, after learning the calibration's error from it.

        The first outline, grown from a motion region, is too rough to learn from.
        """
        left, right = detections
        if left is None or right is None:
            return state, None
        shift, view, stamp_s = None, scene.view, scene.stamp_s
        late_left_s, late_right_s = (camera.stamp_s - stamp_s for camera in scene.cameras)
        if predicted is not None and len(predicted.mean) > 1 and late_left_s != late_right_s:
            p, v = predicted.mean[0], predicted.mean[1]
            shift = (
                -late_left_s * (view.left.project_jacobian(p) @ v),
                -late_right_s * (view.right.project_jacobian(p) @ v),
            )
        pair = view, left.outline, right.outline
        before = state.association
        point = before.triangulated(*pair, shift)
        if isinstance(point, str):
            return state, None
        if predicted is not None:
            state = state._replace(association=before.learned(view, point, left.outline, right.outline))
        observation = state.association.observe(*pair, stamp_s, shift) or before.observe(*pair, stamp_s, shift)
        if observation is None:
            return state, None
        if predicted is not None and shift is not None:
            late_s, velocity_cov = (late_left_s, late_right_s), predicted.cov[3:6, 3:6]
            observation = with_velocity_error(observation, view, late_s, velocity_cov)
        if located is not None:
            observation = replace(
                observation, p_root=located.measured, cov_root=observation.cov_root + located.measured_cov
            )
        hidden = any(e.is_partial and not (e.is_edge or e.is_cut) for e in (left.outline, right.outline))
        is_vague = math.sqrt(float(np.trace(observation.cov_root))) > observation.radius_m
        if hidden and is_vague and state.hits >= self.params.confirm_frames:
            return state, None  # the eyes may follow different parts
        stamp_error_s = scene.poses.stamp_error_s
        if stamp_error_s > 0 and scene.last_view is not None:
            observation = with_pose_error(
                observation, scene.last_view, view, stamp_s - scene.last_stamp_s, stamp_error_s
            )
        return state, observation

    def _update(
        self,
        state: TrackState,
        predicted: Belief | None,
        observation: Observation3D | None,
        scene: _Scene,
    ) -> tuple[TrackState, Belief | None, bool]:
        """The belief after the observation, and whether it was taken in; the first observation starts the filter."""
        if observation is None:
            return state, predicted, False
        if predicted is not None:
            measurement = observation.p_root, observation.cov_root, observation.correlated_cov_root
            shifted = kalman.shifted(predicted, shift_cov(state.observed, observation))
            belief = kalman.update(state.kalman, shifted, *measurement)
            return state, belief, belief.rejections == 0
        view = scene.view
        params = kalman.scaled(self.params.kalman, float(np.linalg.norm(sight(view.centers, observation.p_root))))
        belief = kalman.start(
            params,
            scene.stamp_s,
            observation.p_root,
            observation.cov_root,
            observation.correlated_cov_root,
        )
        return state._replace(kalman=params), belief, True

    def _manage(
        self,
        state: TrackState,
        belief: Belief | None,
        observation: Observation3D | None,
        scene: _Scene,
        located: Located | None,
    ) -> tuple[TrackState, Track3D]:
        """Confirm, coast or delete the track; a frame in which a camera is blind does not break a confirmation."""
        stamp_s = scene.stamp_s
        track_id = state.track_id
        deleted = self._initial._replace(track_id=track_id)
        state = state._replace(belief=belief)
        if belief is None:
            return state, Track3D.unknown(stamp_s, track_id=track_id)
        confirmed = state.hits >= self.params.confirm_frames
        if observation is not None:
            state = state._replace(hits=state.hits + 1, observed=observation)
            if located is None or state.hits == 1:
                state = _with_radius(state, observation)
            elif state.whole_hits < self.params.confirm_frames:
                state = state._replace(radius_m=located.radius_m)
        elif state.observed is not None and stamp_s - state.observed.stamp_s > self.params.lost_after_s:
            return deleted, Track3D.unknown(stamp_s, Status.LOST if confirmed else Status.SEARCHING, track_id)
        elif not confirmed and not scene.is_blind:
            return deleted, Track3D.unknown(stamp_s, track_id=track_id)
        if state.hits < self.params.confirm_frames:
            return state, Track3D.unknown(stamp_s, track_id=track_id)
        status = Status.COASTING if observation is None else Status.TRACKING
        ahead = sight(scene.view.centers, belief.mean[0])
        angles = scene.poses.rotation_std_rad, self.params.aspect_rad
        mean, cov = full_state(belief.mean, belief.cov, belief.correlated_cov, ahead, *angles)
        return state, Track3D(stamp_s, mean, cov, state.radius_m, state.radius_var_m2, status, track_id)

    def _learn_backgrounds(
        self, results: Sequence[tuple[TrackState, TrackerStep, Detections]], cameras: CameraFrames
    ) -> None:
        """Update both backgrounds, except behind the detected objects; a marker that is followed does not need them."""
        if self.params.mode == "marker" and any(track.belief is not None for track, _, _ in results):
            return
        for k, (tracker, camera) in enumerate(zip(self._cameras, cameras, strict=True)):
            boxes = [detection.box_px for _, _, detections in results if (detection := detections[k]) is not None]
            tracker.background.update(camera.image, camera.view, camera.stamp_s, boxes)

    def _learn(
        self, state: TrackState, cameras: CameraFrames, detections: Detections, observation: Observation3D | None
    ) -> TrackState:
        """Update each camera's state, and the object's colours once it is confirmed."""
        by_camera = zip(self._cameras, cameras, detections, strict=True)
        belief = state.belief
        if belief is None:
            return state
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


@njit(cache=True, error_model="numpy")
def _search_cov(centers: Array, p_root: Array, cov: Array, shift: Array, focal_px: float) -> Array:
    """As `Tracker._search_cov`, with the cameras' centers (2, 3), the predicted position (3,), and its covariance in
    the first three rows and columns."""
    line = sight(centers, p_root)
    distance_m = math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
    between = centers[0] - centers[1]
    baseline_m = math.sqrt(between[0] ** 2 + between[1] ** 2 + between[2] ** 2)
    pixel_m = _PIXELS * distance_m / focal_px
    wide = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            along = (pixel_m / baseline_m) ** 2 * line[i] * line[j]
            wide[i, j] = cov[i, j] + shift[i] * shift[j] + along + (pixel_m**2 if i == j else 0.0)
    scale = min((_WIDEST_PX / _PIXELS * pixel_m) ** 2 / (wide[0, 0] + wide[1, 1] + wide[2, 2]), 1.0)
    for i in range(3):
        for j in range(3):
            wide[i, j] *= scale
    return wide


def _urgency(step: TrackerStep) -> tuple[float, float]:
    """1 / time to contact with the cameras (1/s; 0: it does not come), and 1 / distance (1/m; 0: it is at rest).

    An object within two standard deviations of rest does not move.
    """
    track = step.track
    offset = track.position - step.centers_root.mean(axis=0)
    distance_m = float(np.linalg.norm(offset))
    cov = track.cov[3:6, 3:6]
    closing_m_s = -float(track.velocity @ offset) / distance_m
    std_m_s = math.sqrt(max(float(offset @ cov @ offset), 0.0)) / distance_m
    speed_m_s = float(np.linalg.norm(track.velocity))
    moves = speed_m_s > 2 * math.sqrt(float(np.trace(cov)))
    return (closing_m_s / distance_m if closing_m_s > 2 * std_m_s else 0.0), 1 / distance_m if moves else 0.0


def _enlarged(step: TrackerStep, k: int) -> TrackerStep:
    """The step of images reduced `k` times, in pixels of the original images."""
    detections = []
    for detection in step.detections:
        x, y, w, h = detection.box_px
        center_px, box_px = k * (detection.center_px + 0.5) - 0.5, (k * x, k * y, k * w, k * h)
        detections.append(replace(detection, center_px=center_px, cov_px=k**2 * detection.cov_px, box_px=box_px))
    observation = step.observation and replace(step.observation, residual_px=k * step.observation.residual_px)
    others = tuple(_enlarged(other, k) for other in step.others)
    return replace(step, detections=tuple(detections), observation=observation, others=others)


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


def _with_radius(state: TrackState, observation: Observation3D) -> TrackState:
    """The state with the radius averaged over the last frames; its error is correlated, so its variance is that of one
    frame."""
    whole_hits = state.whole_hits + 1
    radius = observation.radius_m if state.hits == 1 else state.radius_m
    radius += (observation.radius_m - radius) / min(whole_hits, _RADIUS_MEMORY)
    return state._replace(radius_m=radius, radius_var_m2=observation.radius_var_m2, whole_hits=whole_hits)


@njit(cache=True, error_model="numpy")
def full_state(
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
