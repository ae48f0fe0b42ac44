"""A robot that fixates what its rendered eyes show: look around, find the marker, centre it in both eyes (J, IV B)."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from control import fixation, search
from control.fixation import FixationParams
from control.head import HeadLimits, gaze_of, gaze_range
from control.search import SearchParams, SearchState
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.gaze import GazeLimits, fixated_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Detection2D
from rendering.eyes import Eyes
from rendering.scene import SceneState
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

_DEG = np.pi / 180
Outcome = Literal["fixated", "at the limits", "eyes disagree", "restless", "not found"]


@dataclass(frozen=True)
class OnlookerParams:
    """Fixation in frames of `period_s`, done when no joint has moved `still_rad` in a frame for `still_frames` and
    both eyes see the marker within `centred_rad` of their axes, given up after `max_frames`.  A marker that is not in
    view is looked for by up to `max_looks` single looks, `look_s` apart, at random within J's gaze limits."""

    period_s: float = 0.05
    still_rad: float = 0.02 * _DEG
    still_frames: int = 3
    centred_rad: float = 0.2 * _DEG
    max_frames: int = 60
    max_looks: int = 40
    look_s: float = 1.0
    ahead_rad: tuple[float, float, float, float] = (0.0, -5 * _DEG, 0.0, 20 * _DEG)  # yaw, pitch, tilt, vergence
    fixation: FixationParams = field(default_factory=lambda: FixationParams(tilt_return_per_s=8.0))
    search: SearchParams = field(default_factory=lambda: SearchParams(55 * _DEG, 40 * _DEG, HeadLimits()))


@dataclass(frozen=True)
class Looked:
    """How it ended, with which joints (n,), and what gaze (3,) rad was read from them (NaN unless fixated); how far
    (rad) the marker last was from the worse eye's axis; frames and looks it took."""

    outcome: Outcome
    q_rad: Array
    gaze_rad: Array
    off_rad: float
    frames: int
    looks: int


class Onlooker:
    """Fixates a marker of a known hue, knowing nothing but its images and joints."""

    def __init__(
        self,
        robot: Robot,
        rig: StereoRig,
        eyes: Eyes,
        marker: MarkerParams,
        rng: np.random.Generator,
        params: OnlookerParams | None = None,
    ) -> None:
        self.robot, self.rig, self.eyes, self.params = robot, rig, eyes, params or OnlookerParams()
        self._tracking, self._rng = TrackerParams("marker", marker=marker), rng

    def fixate(self, q_rad: Array, position: Array, rotation: Array | None = None) -> Looked:
        """From the joints `q_rad` on, a marker that stands still at `position` (3,), turned by `rotation`."""
        p, q = self.params, q_rad
        tracker = Tracker(self._tracking, self.rig, self._rng)
        looking = SearchState(np.array(p.ahead_rad))
        stamp_s, off, frames, looks, still = 0.0, np.nan, 0, 0, 0
        while frames < p.max_frames and looks < p.max_looks:
            seen = tracker.step(self.eyes.render(SceneState(q, position, rotation=rotation), stamp_s, self._rng))
            posture = self.robot.at(q)
            if seen.observation is None and not seen.track.is_known:
                looking, turn = search.step(p.search, looking, posture, p.look_s, self._rng, stamp_s)
                q, stamp_s, looks = self.robot.clamp(q + p.look_s * turn.dq_rad_s), stamp_s + p.look_s, looks + 1
                continue
            frames, stamp_s = frames + 1, stamp_s + p.period_s
            if not seen.track.is_known:  # to be confirmed
                continue
            off = self._off(seen.detections)
            turn = fixation.step(p.fixation, posture, seen.track.position, dt_s=p.period_s, stamp_s=stamp_s)
            still = still + 1 if np.abs(turn.dq_rad_s).max() * p.period_s < p.still_rad else 0
            if still >= p.still_frames:
                outcome, gaze = self._judged(q, off)
                return Looked(outcome, q, gaze, off, frames, looks)
            q = self.robot.clamp(q + p.period_s * turn.dq_rad_s)
        nothing = np.full(3, np.nan)
        return Looked("restless" if frames >= p.max_frames else "not found", q, nothing, off, frames, looks)

    def _off(self, detections: tuple[Detection2D, ...]) -> float:
        """The larger angle between an eye's axis and what it sees; infinite where one sees nothing."""
        if len(detections) < 2:
            return np.inf
        cameras = self.rig.left, self.rig.right
        rays = [camera.bearings(seen.center_px) for camera, seen in zip(cameras, detections, strict=True)]
        return float(max(np.arctan2(np.hypot(x, y), z) for x, y, z in rays))

    def _judged(self, q: Array, off_rad: float) -> tuple[Outcome, Array]:
        """What eyes at rest have come to, and the gaze read."""
        gaze = self.read(q)
        if off_rad <= self.params.centred_rad and np.isfinite(gaze).all():
            return "fixated", gaze
        posture = self.robot.at(q)
        lower, upper = gaze_range(self.params.fixation.limits.gaze, posture)
        at = gaze_of(posture)
        stopped = np.minimum(at - lower, upper - at).min() < self.params.centred_rad
        return "at the limits" if stopped or off_rad <= self.params.centred_rad else "eyes disagree", np.full(3, np.nan)

    def read(self, q_rad: Array) -> Array:
        """(3,) the gaze, from the joints: where the eyes' tilt helps the neck, the gaze without it that meets at the
        same point; NaN where that is beyond J's limits, by more than fixation errs."""
        limits, slack = self.params.fixation.limits.gaze, self.params.centred_rad
        yaw, pitch, vergence = np.stack([limits.lower - slack, limits.upper + slack], axis=1).tolist()
        within = GazeLimits(tuple(yaw), tuple(pitch), tuple(vergence))
        return np.clip(fixated_gaze(self.robot.at(q_rad), within), limits.lower, limits.upper)
