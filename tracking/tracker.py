"""From stereo frames to one tracked object: trigger → image → triangulation → filter (R Fig 13)."""

import itertools
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import StereoRig, StereoView, View
from pps_vision.types import Array, CameraName, Detection2D, Image, Mask, Observation3D, Status, StereoFrame, Track3D
from tracking.acquire import AcquireParams, Candidate, acquire
from tracking.association import Association, AssociationParams
from tracking.background import Background
from tracking.disparity import DisparityParams, refine_distance
from tracking.eye import EyeParams, EyeTracker, Sighting
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update
from tracking.marker import MarkerParams, find_markers
from tracking.outline import ROUND, Optics, Outline
from tracking.particles import Prior
from tracking.trigger import Region2D, Trigger, TriggerParams

OwnBody = Callable[[Array, View], Mask]  # joints (rad), an eye's view → where the robot sees itself
Stages = Callable[[Literal["trigger", "image", "triangulation", "filter"]], AbstractContextManager[object]]


@dataclass(frozen=True)
class TrackerParams:
    """`mode`: any moving object, or a marker of known hue.  `depth`: from the two outlines' centres,
    or (where that works) from the disparity inside the outline.  An object is tracked once seen in both
    eyes on `confirm_frames` frames in a row, and lost when unseen for `lost_after_s`.  Of the
    `max_candidates` most conspicuous things that move, the two eyes' are one when their colours are
    `min_likeness` alike (Bhattacharyya) and their sizes differ by no more than `max_ratio`.  The centre
    of what is no ball may be `shape_error` of its radius off, frame after frame the same."""

    mode: Literal["generic", "marker"] = "generic"
    depth: Literal["centroid", "disparity"] = "centroid"
    confirm_frames: int = 3
    lost_after_s: float = 0.5
    max_candidates: int = 4
    min_likeness: float = 0.7
    max_ratio: float = 1.2
    max_ratio_grey: float = 1.8  # without colour an outline is rougher
    background_memory_s: float = 0.3
    radius_drift: float = 0.05
    shape_error: float = 0.13
    trigger: TriggerParams = field(default_factory=TriggerParams)
    acquire: AcquireParams = field(default_factory=AcquireParams)
    eye: EyeParams = field(default_factory=EyeParams)
    marker: MarkerParams = field(default_factory=MarkerParams)
    disparity: DisparityParams = field(default_factory=DisparityParams)
    association: AssociationParams = field(default_factory=AssociationParams)
    kalman: KalmanParams = field(default_factory=KalmanParams)

    def __post_init__(self) -> None:
        if self.mode not in ("generic", "marker") or self.depth not in ("centroid", "disparity"):
            raise ValueError(
                f"tracker mode {self.mode!r}, depth from {self.depth!r}; "
                "expected 'generic' or 'marker', 'centroid' or 'disparity'"
            )
        if not (self.confirm_frames >= 1 and self.lost_after_s > 0):
            raise ValueError(
                f"confirm after {self.confirm_frames} frames, lost after {self.lost_after_s} s; expected more than 0"
            )


@dataclass(frozen=True, slots=True)
class TrackerStep:
    """What one frame gave: the track, the detections and observation behind it, and while searching
    the moving regions of the left and the right image."""

    track: Track3D
    detections: tuple[Detection2D, ...]
    observation: Observation3D | None
    regions: tuple[list[Region2D], list[Region2D]]


@dataclass(frozen=True, slots=True)
class _Look:
    """One eye's share of a frame."""

    image: Image
    view: View
    stamp_s: float
    joints: Array | None


class _Eye:
    """What is kept for one eye between frames."""

    def __init__(self, name: CameraName, params: TrackerParams, rig: StereoRig, rng: np.random.Generator) -> None:
        self.name = name
        self.params = params
        self.optics = Optics(rig.left if name == "left" else rig.right)
        self.trigger = Trigger(params.trigger, self.optics.camera)
        self.object = EyeTracker(params.eye, self.optics, rng)
        self.background = Background(self.trigger.ego, params.background_memory_s)
        self.offset_px: Array = np.zeros(2)  # of the outline from the track's projection: calibration error
        self.size_px = 0.0

    def candidates(self, look: _Look, regions: list[Region2D], evidence: NDArray[np.float32] | None) -> list[Candidate]:
        """Objects behind the strongest moving regions."""
        strongest = regions[: self.params.max_candidates]
        found = (acquire(self.params.acquire, look.image, r, self.optics, evidence) for r in strongest)
        return [candidate for candidate in found if candidate is not None]

    def markers(self, look: _Look) -> list[Sighting]:
        """What may be the marker, anywhere in the image."""
        found = find_markers(self.params.marker, look.image, self.optics)
        return [Sighting(shape, shape.box_px, 1.0) for shape in found]

    def marker(self, look: _Look, prior: Prior) -> Sighting | None:
        """The marker where it should be: the nearest blob in reach."""
        x, y = prior.center_px
        half = 0.5 * self.size_px * (1 + self.params.marker.reach) + 4 * prior.std_px + 3
        found = find_markers(self.params.marker, look.image, self.optics, (float(x), float(y), half))
        if not found:
            return None
        shape = min(found, key=lambda one: float(np.linalg.norm(one.center_px - prior.center_px)))
        return Sighting(shape, shape.box_px, 1.0)


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
        self.params, self.rig, self.own_body, self.stages = params, rig, own_body, stages
        self._eyes = (_Eye("left", params, rig, rng), _Eye("right", params, rig, rng))
        self._association = Association(params.association, rig.left.width)
        self._kalman = params.kalman
        self._belief: Belief | None = None
        self._head: Array = np.zeros(3)
        self._radius = (np.nan, np.nan)  # m, m²
        self._oddness = 0.0  # 0 a ball … 1 surely none
        self._hits = 0
        self._seen_s = -np.inf
        self._stamps = (-np.inf, -np.inf)

    def step(self, frame: StereoFrame) -> TrackerStep:
        """The track after this frame; ValueError for a stamp that does not lie after the last one."""
        self._check_stamps(frame)
        view = self.rig.view_of(frame)
        looks = (
            _Look(frame.left, view.left, frame.stamp_left_s, frame.joints_left_rad),
            _Look(frame.right, view.right, frame.stamp_right_s, frame.joints_right_rad),
        )
        regions: tuple[list[Region2D], list[Region2D]] = ([], [])
        grey = self.params.mode == "generic" and _is_grey(frame.left)
        if self._belief is None:
            sightings, regions = self._search(looks, view, frame.stamp_s, grey)
        else:
            with self.stages("image"):
                last = self._belief
                self._belief = predict(self._kalman, last, frame.stamp_s)
                sightings = self._follow(last, self._belief, looks, grey)
        self._head = 0.5 * (view.left.center + view.right.center)
        with self.stages("triangulation"):
            observation = self._observe(view, looks, sightings, frame.stamp_s)
        with self.stages("filter"):
            track = self._filter(observation, frame.stamp_s)
            self._after(looks, sightings, observation, grey)
        return TrackerStep(track, _detections(self._eyes, looks, sightings), observation, regions)

    def _check_stamps(self, frame: StereoFrame) -> None:
        stamps = (frame.stamp_left_s, frame.stamp_right_s)
        for name, new, old in zip(("left", "right"), stamps, self._stamps, strict=True):
            if not new > old:
                raise ValueError(f"{name} stamp {new:.6f} s after {old:.6f} s; expected rising stamps")
        self._stamps = stamps

    def _search(
        self, looks: tuple[_Look, _Look], view: StereoView, stamp_s: float, grey: bool
    ) -> tuple[tuple[Sighting | None, Sighting | None], tuple[list[Region2D], list[Region2D]]]:
        """Look for an object anywhere in both images."""
        if self.params.mode == "marker":
            with self.stages("image"):
                lefts, rights = (eye.markers(look) for eye, look in zip(self._eyes, looks, strict=True))
                for a, b in itertools.product(lefts, rights):
                    if self._association.observe(view, a.outline, b.outline, stamp_s):
                        return (a, b), ([], [])
            return (None, None), ([], [])
        with self.stages("trigger"):
            left_regions, right_regions = (
                eye.trigger.step(look.image, look.view, look.stamp_s, self._own(look))
                for eye, look in zip(self._eyes, looks, strict=True)
            )
        regions = left_regions, right_regions
        if not (left_regions and right_regions):
            return (None, None), regions
        with self.stages("image"):
            found = [
                eye.candidates(look, r, eye.background.evidence(look.image, look.view) if grey else None)
                for eye, look, r in zip(self._eyes, looks, regions, strict=True)
            ]
            pair = self._best_pair(view, found[0], found[1], stamp_s, grey)
            if pair is None:
                return (None, None), regions
            for eye, look, candidate in zip(self._eyes, looks, pair, strict=True):
                eye.object.start(look.image, candidate.outline.box_px, candidate.model, candidate.spread)
            left, right = (Sighting(c.outline, c.outline.box_px, 1.0) for c in pair)
        return (left, right), regions

    def _own(self, look: _Look) -> Mask | None:
        return self.own_body(look.joints, look.view) if self.own_body and look.joints is not None else None

    def _best_pair(
        self, view: StereoView, left: list[Candidate], right: list[Candidate], stamp_s: float, grey: bool
    ) -> tuple[Candidate, Candidate] | None:
        """The two candidates that are one object, with most evidence; colours must agree too."""
        best, most = None, 0.0
        most_ratio = self.params.max_ratio_grey if grey else self.params.max_ratio
        for a, b in itertools.product(left, right):
            likeness = 1.0 if grey else a.model.similarity(b.model.object)  # eyes differ in exposure
            ratio = a.outline.angular_radius_rad / b.outline.angular_radius_rad
            evidence = likeness * float(np.sqrt(a.evidence * b.evidence))
            if evidence <= most or likeness < self.params.min_likeness or max(ratio, 1 / ratio) > most_ratio:
                continue
            if self._association.observe(view, a.outline, b.outline, stamp_s):
                best, most = (a, b), evidence
        return best

    def _follow(
        self, last: Belief, now: Belief, looks: tuple[_Look, _Look], grey: bool
    ) -> tuple[Sighting | None, Sighting | None]:
        """Find the object again, near where the track says it is now."""
        found: list[Sighting | None] = []
        for eye, look in zip(self._eyes, looks, strict=True):
            prior = _prior(eye, look, last, now)
            if prior is None:
                found.append(None)
            elif self.params.mode == "marker":
                found.append(eye.marker(look, prior))
            else:
                evidence = eye.background.evidence(look.image, look.view) if grey else None
                found.append(eye.object.step(look.image, prior, evidence))
        return found[0], found[1]

    def _observe(
        self,
        view: StereoView,
        looks: tuple[_Look, _Look],
        sightings: tuple[Sighting | None, Sighting | None],
        stamp_s: float,
    ) -> Observation3D | None:
        left, right = sightings
        if left is None or right is None:
            return None
        shift = None
        if self._belief is not None and self.params.kalman.order > 1 and looks[0].stamp_s != looks[1].stamp_s:
            p, v = self._belief.mean[0], self._belief.mean[1]
            shift = tuple(look.view.project_jacobian(p) @ v * (stamp_s - look.stamp_s) for look in looks)
        observation = self._association.observe(view, left.outline, right.outline, stamp_s, shift)
        if observation is not None and self._hits > 0:  # the first outline, grown from motion, is rough
            self._association.learn(observation, left.outline, right.outline)
        if observation is not None and self.params.depth == "disparity":
            images = looks[0].image, looks[1].image
            refined = refine_distance(self.params.disparity, view, *images, left.outline, observation)
            observation = refined or observation
        return observation

    def _filter(self, observation: Observation3D | None, stamp_s: float) -> Track3D:
        """Take the observation into the belief and decide what is known."""
        params = self._kalman
        seen = observation is not None
        if observation is not None:
            if self._belief is None:
                self._kalman = params = scaled(
                    self.params.kalman, float(np.linalg.norm(observation.p_root - self._head))
                )
                self._belief = start(params, stamp_s, observation.p_root, observation.cov_root)
            else:
                self._belief = update(params, self._belief, observation.p_root, observation.cov_root)
                seen = self._belief.rejections == 0
        if self._belief is None:
            return Track3D.unknown(stamp_s)
        if seen and observation is not None:
            self._blend_radius(observation, stamp_s)
            self._hits += 1
            self._seen_s = stamp_s
        elif self._hits < self.params.confirm_frames:
            self._forget()
            return Track3D.unknown(stamp_s)
        elif stamp_s - self._seen_s > self.params.lost_after_s:
            self._forget()
            return Track3D.unknown(stamp_s, Status.LOST)
        if self._hits < self.params.confirm_frames:
            return Track3D.unknown(stamp_s)
        return self._track(self._belief, Status.TRACKING if seen else Status.COASTING)

    def _track(self, belief: Belief, status: Status) -> Track3D:
        order = self.params.kalman.order
        mean, cov = np.zeros((4, 3)), np.zeros((12, 12))
        mean[:order], cov[: 3 * order, : 3 * order] = belief.mean, belief.cov
        # An outline's centre is not the body's; the filter cannot average out what hardly changes.
        cov[:3, :3] += (self.params.shape_error * self._oddness * self._radius[0]) ** 2 * np.eye(3)
        return Track3D(belief.stamp_s, mean, cov, self._radius[0], self._radius[1], status)

    def _blend_radius(self, observation: Observation3D, stamp_s: float) -> None:
        """A scalar Kalman filter on a size that hardly changes."""
        if self._hits == 0:
            self._radius = observation.radius_m, observation.radius_var_m2
            return
        value, var = self._radius
        var += (self.params.radius_drift * value) ** 2 * (stamp_s - self._seen_s)
        gain = var / (var + observation.radius_var_m2)
        self._radius = value + gain * (observation.radius_m - value), (1 - gain) * var

    def _forget(self) -> None:
        self._belief, self._hits, self._oddness = None, 0, 0.0
        self._association.forget()
        for eye in self._eyes:
            eye.object.forget()

    def _after(
        self,
        looks: tuple[_Look, _Look],
        sightings: tuple[Sighting | None, Sighting | None],
        observation: Observation3D | None,
        grey: bool,
    ) -> None:
        """Remember, for each eye, where the object is relative to the track, and the scene without it."""
        for eye, look, seen in zip(self._eyes, looks, sightings, strict=True):
            if seen is not None and observation is not None and self._belief is not None:
                eye.offset_px = seen.outline.center_px - look.view.project(self._belief.mean[0])
                rate = 0.5 / min(self._hits, 10)  # two eyes a frame
                self._oddness += rate * (_oddness(seen.outline) - self._oddness)
                eye.size_px = 2 * seen.outline.angular_radius_rad * eye.optics.camera.focal_px
            if grey:
                eye.background.learn(look.image, look.view, look.stamp_s, [seen.box_px] if seen else [])


def _oddness(shape: Outline) -> float:
    """0 for the image of a ball, 1 for what is clearly something else (a cube, a toy with limbs)."""
    return float(np.clip((shape.departure - ROUND) / ROUND, 0.0, 1.0))


def _prior(eye: _Eye, look: _Look, last: Belief, now: Belief) -> Prior | None:
    """Where the track says this eye sees the object; None where it cannot."""
    p = now.mean[0]
    if len(now.mean) > 1:
        p = p + now.mean[1] * (look.stamp_s - now.stamp_s)
    center = look.view.project(p) + eye.offset_px
    if not eye.optics.camera.contains(center, margin_px=-0.5 * eye.size_px):
        return None
    J = look.view.project_jacobian(p)
    std = float(np.sqrt(np.trace(J @ now.cov[:3, :3] @ J.T)))
    growth = float(np.linalg.norm(last.mean[0] - look.view.center) / np.linalg.norm(p - look.view.center))
    return Prior(center, float(np.clip(std, 0.7, 40.0)), float(np.clip(growth, 0.8, 1.25)))


def _detections(
    eyes: tuple[_Eye, _Eye], looks: tuple[_Look, _Look], sightings: tuple[Sighting | None, Sighting | None]
) -> tuple[Detection2D, ...]:
    return tuple(
        _detection(eye.name, look.stamp_s, seen.outline, seen.box_px, seen.score)
        for eye, look, seen in zip(eyes, looks, sightings, strict=True)
        if seen is not None
    )


def _detection(
    name: CameraName, stamp_s: float, shape: Outline, box: tuple[float, float, float, float], score: float
) -> Detection2D:
    return Detection2D(stamp_s, name, shape.center_px, shape.cov_px, score, shape.angular_radius_rad, box)


def _is_grey(image: Image) -> bool:
    """Whether an RGB image carries no colour at all."""
    few = image[::16, ::16]
    return bool((few[..., 0] == few[..., 1]).all() and (few[..., 1] == few[..., 2]).all())
