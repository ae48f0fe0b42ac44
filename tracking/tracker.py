"""From stereo frames to one tracked object: trigger → image → triangulation → filter (R Fig 13)."""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numba import njit

from pps_vision.geometry.camera import StereoRig, StereoView
from pps_vision.types import Array, Detection2D, Observation3D, Status, StereoFrame, Track3D
from tracking.acquire import Candidate
from tracking.again import AgainParams, is_same
from tracking.association import Association, AssociationParams
from tracking.blind import Blindness
from tracking.color import ColorModel
from tracking.eye import EyeParams, Sighting
from tracking.follow import Follower, find_both
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update
from tracking.look import Looks, is_grey, looks_of
from tracking.marker import Found, MarkerParams
from tracking.optical_flow import velocity
from tracking.outline import Optics, Outline
from tracking.pose_error import PoseError
from tracking.search import OwnBody, Regions, Search, SearchParams, Stages, search_marker

Appearance = MarkerParams | ColorModel
Sightings = tuple[Sighting | None, Sighting | None]


@dataclass(frozen=True)
class TrackerParams:
    """`mode`: any moving object, or a marker of known hue.  An object is tracked once seen in both
    eyes on `confirm_frames` frames in a row, and lost when unseen for `lost_after_s`; until then it is
    looked for everywhere (`again`).  Stamps may be `stamp_error_s` off the joints', so that a turning head
    blurs where things are.  The centre of what is no ball may be `shape_error` of its radius off, frame
    after frame the same; light from above may shift any by `light_error` px over the root of its radius in px,
    up or down, in both eyes alike, and the less the more they see it from above.  Only `radius_white` of the
    radius's variance is new with every frame."""

    mode: Literal["generic", "marker"] = "generic"
    confirm_frames: int = 3
    lost_after_s: float = 0.5
    stamp_error_s: float = 0.0
    background_memory_s: float = 0.3
    radius_drift: float = 0.05
    shape_error: float = 0.09
    light_error: float = 0.13
    radius_white: float = 0.2
    again: AgainParams = field(default_factory=AgainParams)
    search: SearchParams = field(default_factory=SearchParams)
    eye: EyeParams = field(default_factory=EyeParams)
    marker: MarkerParams = field(default_factory=MarkerParams)
    association: AssociationParams = field(default_factory=AssociationParams)
    kalman: KalmanParams = field(default_factory=KalmanParams)

    def __post_init__(self) -> None:
        if self.mode not in ("generic", "marker"):
            raise ValueError(f"tracker mode {self.mode!r}; expected 'generic' or 'marker'")
        if not (self.confirm_frames >= 1 and self.lost_after_s > 0):
            raise ValueError(
                f"confirm after {self.confirm_frames} frames, lost after {self.lost_after_s} s; expected more than 0"
            )


@dataclass(frozen=True, slots=True)
class TrackerStep:
    """What one frame gave: the track, the detections and observation behind it, while searching the moving
    regions of the left and the right image, and the point (3,) midway between the eyes, root frame."""

    track: Track3D
    detections: tuple[Detection2D, ...]
    observation: Observation3D | None
    regions: Regions
    head: Array


class Tracker:
    """Tracks one object in 3D.  `step` takes frames in the order of their stamps.

    `own_body` marks the robot's own image, which is no stimulus; `stages` is entered around each
    stage (to time it).
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
        self._optics = Optics(rig.left), Optics(rig.right)
        marker = params.marker if params.mode == "marker" else None
        self._eyes = (
            Follower("left", self._optics[0], params.eye, marker, params.background_memory_s, rng),
            Follower("right", self._optics[1], params.eye, marker, params.background_memory_s, rng),
        )
        self._association = Association(params.association, rig.left.width)
        self._search = Search(params.search, self._optics, self._association, own_body, stages)
        self._blindness, self._pose = Blindness(), PoseError(params.stamp_error_s)
        self._kalman = params.kalman
        self._belief: Belief | None = None
        self._appearance: tuple[Appearance, Appearance] | None = (marker, marker) if marker else None
        self._found: tuple[Candidate, Candidate] | None = None  # as which the search found it, until it is confirmed
        self._head: Array = np.zeros(3)
        self._radius = (np.nan, np.nan)  # m, m²
        self._radius_lasting = 0.0  # m², as Belief.lasting
        self._oddness = 0.0  # 0 a ball … 1 surely none
        self._hits = 0
        self._seen_s = -np.inf
        self._stamps = (-np.inf, -np.inf)
        self._period_s = np.inf

    @property
    def appearance(self) -> tuple[Appearance, Appearance] | None:
        """The marker's hue, or the object's colours when it was confirmed, in the left and the right eye; None while
        there is no object, or no colour."""
        return self._appearance

    def step(self, frame: StereoFrame, found: tuple[Found, Found] = (None, None)) -> TrackerStep:
        """The track after this frame; ValueError for a stamp that does not lie after the last one, or images that are
        not the cameras'; nothing has changed then.

        `found` is the object in the left and the right image, where it has been looked for already (`batch`).
        """
        self._check(frame)
        view = self.rig.view_of(frame)
        looks = looks_of(frame, view)
        regions: Regions = ([], [])
        grey = self.params.mode == "generic" and is_grey(frame.left)
        if grey:
            found = (None, None)
        last = self._belief
        if last is not None:
            self._belief = predict(self._kalman, last, frame.stamp_s)
        blind = self._blindness.step(frame)
        if blind:
            sightings: Sightings = (None, None)
        elif last is None or self._belief is None:
            sightings, regions = self._begin(looks, view, frame.stamp_s, grey, found)
        elif not grey and self._is_carrier(looks):
            self._forget()
            sightings = None, None
        else:
            with self.stages("image"):
                sightings = find_both(self._eyes, looks, last, self._belief, grey, self._oddness > 0.5, found)
            if None in sightings and self._hits >= self.params.confirm_frames and not grey:
                elsewhere, regions = self._begin(looks, view, frame.stamp_s, grey, found)
                if elsewhere[0] is not None:  # what was known of its motion is void
                    sightings, self._belief = elsewhere, None
        self._head = 0.5 * (view.left.center + view.right.center)
        with self.stages("triangulation"):
            observation = self._pose.widen(self._observe(view, looks, sightings, frame.stamp_s), view, frame.stamp_s)
        with self.stages("filter"):
            track = self._filter(observation, view, frame.stamp_s, blind)
            if not blind:
                self._after(looks, sightings, observation, grey)
        seen = zip(self._eyes, looks, sightings, strict=True)
        detections = tuple(eye.detection(look, one) for eye, look, one in seen if one is not None)
        return TrackerStep(track, detections, observation, regions, self._head)

    def _check(self, frame: StereoFrame) -> None:
        stamps, images = (frame.stamp_left_s, frame.stamp_right_s), (frame.left, frame.right)
        for eye, new, old, image in zip(self._eyes, stamps, self._stamps, images, strict=True):
            if not old < new < np.inf:
                raise ValueError(f"{eye.name} stamp {new:.6f} s after {old:.6f} s; expected rising stamps")
            expected = eye.optics.camera.height, eye.optics.camera.width, 3
            if image.shape != expected or image.dtype != np.uint8:
                raise ValueError(f"{eye.name} image {image.shape} {image.dtype}; expected {expected} uint8")
        self._period_s = stamps[0] - self._stamps[0]
        self._stamps = stamps

    def _begin(
        self, looks: Looks, view: StereoView, stamp_s: float, grey: bool, found: tuple[Found, Found]
    ) -> tuple[Sightings, Regions]:
        """Look for an object anywhere in both images; while one is tracked, for no other."""
        if self.params.mode == "marker":
            with self.stages("image"):
                marker = search_marker(self.params.marker, looks, view, stamp_s, self._optics, self._association, found)
            same = marker is not None and self._is_wanted(view, marker, stamp_s, (None, None))
            return _sightings(marker if marker and same else (None, None)), ([], [])
        scenes = (self._eyes[0].background, self._eyes[1].background) if grey else None
        pair, regions = self._search.step(looks, view, stamp_s, scenes)
        if pair is None or not self._is_wanted(
            view, (pair[0].outline, pair[1].outline), stamp_s, (pair[0].model, pair[1].model)
        ):
            return (None, None), regions
        self._found = pair
        with self.stages("image"):
            for eye, look, one in zip(self._eyes, looks, pair, strict=True):
                flow = one.flow
                shift_px = None if flow is None else (flow.now_px - flow.then_px) / flow.interval_s * self._period_s
                eye.object.start(look.image, one.outline.box_px, one.model, one.spread, shift_px)
        return _sightings((pair[0].outline, pair[1].outline)), regions

    def _is_carrier(self, looks: Looks) -> bool:
        """Whether what is not yet confirmed turns out to carry what should be tracked."""
        if self._found is None or self._hits >= self.params.confirm_frames:
            return False
        return self._search.is_carrier(self._found, looks)

    def _is_wanted(
        self, view: StereoView, shapes: tuple[Outline, Outline], stamp_s: float, models: Sequence[ColorModel | None]
    ) -> bool:
        """Whether what was found may be tracked: anything while nothing is, else only the same again."""
        if self._belief is None:
            return True
        seen = self._association.observe(view, *shapes, stamp_s)
        return is_same(self.params.again, [eye.object.model for eye in self._eyes], self._radius[0], models, seen)

    def _observe(self, view: StereoView, looks: Looks, sightings: Sightings, stamp_s: float) -> Observation3D | None:
        left, right = sightings
        if left is None or right is None:
            return None
        shift = None
        if self._belief is not None and self.params.kalman.order > 1 and looks[0].stamp_s != looks[1].stamp_s:
            p, v = self._belief.mean[0], self._belief.mean[1]
            shift = tuple(look.view.project_jacobian(p) @ v * (stamp_s - look.stamp_s) for look in looks)
        observation = self._association.observe(view, left.outline, right.outline, stamp_s, shift)
        if observation is not None and self._belief is not None:  # the first outline, grown from motion, is rough
            self._association.learn(observation, left.outline, right.outline)
        return observation

    def _filter(self, observation: Observation3D | None, view: StereoView, stamp_s: float, blind: bool) -> Track3D:
        """Take the observation into the belief and decide what is known; blind eyes refute nothing for a while."""
        params = self._kalman
        seen = observation is not None
        if observation is not None:
            if self._belief is None:
                self._kalman = params = scaled(
                    self.params.kalman, float(np.linalg.norm(observation.p_root - self._head))
                )
                self._belief = self._start(observation, view, stamp_s)
            else:
                self._belief = update(params, self._belief, observation.p_root, observation.cov_root)
                seen = self._belief.rejections == 0
        if self._belief is None:
            return Track3D.unknown(stamp_s)
        if seen and observation is not None:
            self._blend_radius(observation, stamp_s)
            self._hits += 1
            self._seen_s = stamp_s
        elif stamp_s - self._seen_s > self.params.lost_after_s:
            status = Status.LOST if self._hits >= self.params.confirm_frames else Status.SEARCHING
            self._forget()
            return Track3D.unknown(stamp_s, status)
        elif self._hits < self.params.confirm_frames and not blind:
            self._forget()
            return Track3D.unknown(stamp_s)
        if self._hits < self.params.confirm_frames:
            return Track3D.unknown(stamp_s)
        return self._track(self._belief, Status.TRACKING if seen else Status.COASTING)

    def _start(self, observation: Observation3D, view: StereoView, stamp_s: float) -> Belief:
        """The belief after the first measurement; optical flow, where there is any, tells its velocity."""
        found, params = self._found, self._kalman
        flows = (found[0].flow, found[1].flow) if found else (None, None)
        position_px = math.sqrt(params.white_share) * self._association.error_px
        measured = velocity(flows, view, observation.p_root, params.prior_std[:2], position_px) or (None, None)
        return start(params, stamp_s, observation.p_root, observation.cov_root, *measured)

    def _track(self, belief: Belief, status: Status) -> Track3D:
        """What an outline's centre is off the body's, and what hardly changes, no filter averages out."""
        mean, cov = _whole_state(
            *(belief.mean, belief.cov, belief.lasting, belief.mean[0] - self._head),
            self.params.light_error / (self._optics[0].camera.focal_px ** 3 * self._radius[0]) ** 0.5,
            (self.params.shape_error * self._oddness * self._radius[0]) ** 2,
        )
        return Track3D(belief.stamp_s, mean, cov, self._radius[0], self._radius[1] + self._radius_lasting, status)

    def _blend_radius(self, observation: Observation3D, stamp_s: float) -> None:
        """A scalar Kalman filter on a size that hardly changes."""
        white = self.params.radius_white * observation.radius_var_m2
        self._radius_lasting = observation.radius_var_m2 - white
        if self._hits == 0:
            self._radius = observation.radius_m, white
            return
        value, var = self._radius
        var += (self.params.radius_drift * value) ** 2 * (stamp_s - self._seen_s)
        gain = var / (var + white)
        self._radius = value + gain * (observation.radius_m - value), (1 - gain) * var

    def _forget(self) -> None:
        self._belief, self._found, self._hits, self._oddness = None, None, 0, 0.0
        if self.params.mode == "generic":
            self._appearance = None
        self._association.forget()
        for eye in self._eyes:
            eye.forget()

    def _after(self, looks: Looks, sightings: Sightings, observation: Observation3D | None, grey: bool) -> None:
        """Remember, for each eye, where the object is relative to the track, and the scene without it."""
        if self._appearance is None and self._hits >= self.params.confirm_frames and not grey:
            left, right = (eye.object.model for eye in self._eyes)
            self._appearance = (left, right) if left and right else None
        for eye, look, seen in zip(self._eyes, looks, sightings, strict=True):
            if seen is not None and observation is not None and self._belief is not None:
                eye.remember(look, seen.outline, self._belief)
                rate = 0.5 / min(self._hits, 10)  # two eyes a frame
                self._oddness += rate * (seen.outline.oddness - self._oddness)
            if grey:
                eye.background.learn(look.image, look.view, look.stamp_s, [seen.box_px] if seen else [])


def _sightings(shapes: tuple[Outline | None, Outline | None]) -> Sightings:
    """Outlines found without a tracker, as sightings."""
    left, right = (None if shape is None else Sighting(shape, shape.box_px, 1.0) for shape in shapes)
    return left, right


@njit(cache=True, error_model="numpy")
def _whole_state(
    mean: Array, cov: Array, lasting: Array, ahead: Array, light: float, shape_var: float
) -> tuple[Array, Array]:
    """The state (4, 3) with what a filter does not model at zero, and its covariance (12, 12); to its position comes
    what is `lasting` (3, 3), what its shape does in all directions (m²), and, since what is lit from above seems to
    be elsewhere, along the image's vertical there, at `ahead` (3,) of the head, `light` (m^-½: `light_error` over the
    root of focal length in px cubed times radius)."""
    whole, whole_cov = np.zeros((4, 3)), np.zeros((12, 12))
    for i in range(len(cov)):
        whole[i // 3, i % 3] = mean[i // 3, i % 3]
        for j in range(len(cov)):
            whole_cov[i, j] = cov[i, j]
    x, y, z = ahead[0], ahead[1], ahead[2]
    along = light * math.sqrt((x * x + y * y) / (x * x + y * y + z * z) ** 1.5)
    shift = -x * z * along, -y * z * along, (x * x + y * y) * along
    for i in range(3):
        for j in range(3):
            whole_cov[i, j] += lasting[i, j] + shift[i] * shift[j] + (shape_var if i == j else 0.0)
    return whole, whole_cov
