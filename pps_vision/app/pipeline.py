"""One frame through the whole robot: eyes → track → skin, reachable space → arm and gaze.  Read this first.

The same steps run on rendered and on recorded frames; a recording just does not obey the commands.
"""

from dataclasses import dataclass

import numpy as np

from control import avoidance, fixation, search
from control.avoidance import AvoidanceParams
from control.fixation import FixationParams
from control.head import gaze_of
from control.search import SearchParams
from learning.bimodal import bimodal_activation
from learning.pps import learner
from learning.pps.buffer import EventBuffer
from learning.pps.learner import LearnerParams
from learning.pps.memory import PPSMemory, activation
from learning.pps.receptive_field import ReceptiveField, perceive
from learning.reach.map import ReachableMap
from learning.reach.track_reachability import TrackReachability
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity, Mask, Reachability, StereoFrame, TaxelEvents, Track3D
from tracking.tracker import Tracker, TrackerStep


@dataclass(frozen=True)
class PipelineParams:
    """The parameters of everything after the tracker, and the period of the loop."""

    period_s: float = 0.05
    search_for_s: float = 2.0  # how long the eyes look around for a lost object
    bimodal: bool = False  # a taxel that is touched is active too, seen or not (R's discussion)
    max_false_positives: float = 1e-3  # share of the unreachable that the map may call reachable (J: few)
    receptive_field: ReceptiveField = ReceptiveField()
    learning: LearnerParams = LearnerParams()
    fixation: FixationParams = FixationParams()
    search: SearchParams = SearchParams()
    avoidance: AvoidanceParams = AvoidanceParams(HOME_ARM_RAD)


@dataclass(frozen=True, slots=True)
class PipelineStep:
    """All that one frame led to; `activations` (n,) one a taxel; no `reachability` without a map."""

    posture: Posture
    tracking: TrackerStep
    events: TaxelEvents
    activations: Array
    reachability: Reachability | None
    response: avoidance.Response
    command: JointVelocity


class Pipeline:
    """Holds the robot's parameters and state; `step` takes a frame to the joint velocities it asks for.

    It learns from every touch it is told of, so its `memory` grows as it runs.  With a reachable-space map
    (`learning.reach.map.load_map` reads what `pps-vision reach train` writes) every step says whether the tracked
    object is within reach; without one there is no such answer, and an arm that is to reach is refused.
    """

    def __init__(
        self,
        params: PipelineParams,
        robot: Robot,
        skin: Skin,
        tracker: Tracker,
        memory: PPSMemory,
        rng: np.random.Generator,
        reachable_map: ReachableMap | None = None,
    ) -> None:
        if memory.taxel_ids != skin.taxel_ids:
            n, m = len(memory.taxel_ids), len(skin.taxel_ids)
            raise ValueError(f"a memory of {n} other taxels; expected the skin's {m}")
        side, of = params.avoidance.side, reachable_map.side if reachable_map else "no arm"
        if params.avoidance.behaviour == "reach" and of != side:
            raise ValueError(f"a reachable-space map of {of} for the {side} arm, which is to reach; expected its own")
        self.params, self.robot, self.skin, self.tracker, self._rng = params, robot, skin, tracker, rng
        self._learner = learner.LearnerState(memory, EventBuffer())
        self._arm_skin = Skin(tuple(part for part in skin.parts if part.name.startswith(params.avoidance.side)))
        self._of_arm = np.isin(skin.taxel_ids, self._arm_skin.taxel_ids)
        self._arm = avoidance.AvoidanceState()
        self._search: search.SearchState | None = None
        self._known_s = -np.inf
        self._last: tuple[float, Array] | None = None  # stamp, taxel positions
        self._reachability = reachable_map and TrackReachability(robot, reachable_map, params.max_false_positives)

    @property
    def memory(self) -> PPSMemory:
        """What has been learned so far."""
        return self._learner.memory

    def step(self, frame: StereoFrame, touched: Mask | None = None) -> PipelineStep:
        """One frame, and the taxels (n,) the skin reports touched with it; ValueError, and nothing has changed, if
        these are not the robot's cameras or skin."""
        if touched is not None and touched.shape != (len(self.skin.taxel_ids),):
            raise ValueError(f"touched {touched.shape}; expected the skin's {len(self.skin.taxel_ids)} taxels")
        posture = self.robot.at(joints_of(frame))
        tracking = self.tracker.step(frame)
        events = self._perceive(posture, tracking.track, touched)
        self._learner = learner.step(self.params.learning, self._learner, events)
        activations = activation(self.memory, events.distance_m, events.ttc_s)
        if self.params.bimodal:
            activations = bimodal_activation(activations, events.touched)
        reachability = self._reachability(posture.q_rad, tracking.track) if self._reachability else None
        self._arm, arm, response = avoidance.step(
            self.params.avoidance,
            self._arm,
            posture,
            self._arm_skin,
            activations[self._of_arm],
            frame.stamp_s,
            may_reach=reachability is not None and reachability.is_reachable,
        )
        gaze = self._gaze(posture, tracking.track)
        command = JointVelocity(frame.stamp_s, arm.dq_rad_s + gaze.dq_rad_s)
        return PipelineStep(posture, tracking, events, activations, reachability, response, command)

    @property
    def rejected(self) -> dict[str, int]:
        """What could not be learned from: samples out of order, touches by what nobody saw."""
        return {"stale samples": self._learner.stale, "unseen touches": self._learner.unseen}

    def finish(self) -> PPSMemory:
        """Learn a contact that still goes on, and return the memory."""
        self._learner = learner.finish(self._learner)
        return self.memory

    def _perceive(self, posture: Posture, track: Track3D, touched: Mask | None) -> TaxelEvents:
        """D and TTC of the track for every taxel; the sooner of what the object does to a taxel at
        rest and to the taxel as it moves, so that an arm in flight does not forget what it flees."""
        positions, normals = self.skin.at(posture)
        n = len(positions)
        moving = np.zeros_like(positions)
        if self._last is not None and track.stamp_s > self._last[0]:
            moving = (positions - self._last[1]) / (track.stamp_s - self._last[0])
        self._last = track.stamp_s, positions
        D, ttc = np.full(n, np.nan), np.full(n, np.nan)
        if track.is_known:
            what = (
                self.params.receptive_field,
                positions,
                normals,
                track.position,
                track.velocity,
                track.radius_m,
                track.cov[3:6, 3:6],
            )
            D, at_rest = perceive(*what)
            ttc = _sooner(at_rest, perceive(*what, moving)[1])
        return TaxelEvents(
            track.stamp_s, self.skin.taxel_ids, D, ttc, np.zeros(n, bool) if touched is None else touched
        )

    def _gaze(self, posture: Posture, track: Track3D) -> JointVelocity:
        """Fixate what is tracked, look around for what was just lost, else keep still."""
        if track.is_known:
            self._search, self._known_s = None, track.stamp_s
            ahead = track.position + track.velocity * self.params.period_s
            return fixation.step(
                self.params.fixation, posture, ahead, track.velocity, self.params.period_s, track.stamp_s
            )
        if track.stamp_s - self._known_s < self.params.search_for_s:
            state = self._search or search.SearchState(gaze_of(posture))
            self._search, command = search.step(
                self.params.search, state, posture, self.params.period_s, self._rng, track.stamp_s
            )
            return command
        return JointVelocity(track.stamp_s, np.zeros(self.robot.n_joints))


def joints_of(frame: StereoFrame) -> Array:
    """(n_joints,) rad, half-way between the images; ValueError where the frame knows of none."""
    if frame.joints_left_rad is None or frame.joints_right_rad is None:
        raise ValueError("a frame without joints: the skin's place is unknown; expected a robot's recording")
    joints: Array = 0.5 * (frame.joints_left_rad + frame.joints_right_rad)
    return joints


def _sooner(a: Array, b: Array) -> Array:
    """The smaller of two times to contact where both are to come, else the one that is; NaN stays."""
    return np.where(a >= 0, np.where(b >= 0, np.minimum(a, b), a), b)
