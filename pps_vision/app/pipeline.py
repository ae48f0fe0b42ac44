"""One stereo frame through the whole robot: tracker, skin, reachable space, arm and gaze.

Rendered and recorded frames take the same steps; a recording does not obey the commands.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from control import arbiter, avoidance, fixation, lean, limits, neck_and_eyes, search
from control.avoidance import AvoidanceParams, AvoidanceState
from control.fixation import FixationParams
from control.head import carried_velocity, gaze_of
from control.latency import posture_after
from control.lean import LeanParams
from control.limits import MAX_HOLD_S, LimitParams
from control.neck_and_eyes import NeckAndEyesParams
from control.search import SearchParams, SearchState
from learning.pps import learner
from learning.pps.buffer import EventBuffer
from learning.pps.learner import LearnerState
from learning.pps.memory import PPSMemory, activation
from learning.pps.receptive_field import ReceptiveField, likely_velocities, perceive
from learning.reach.map import ReachableMap
from learning.reach.track_reachability import TrackReachability
from pps_vision.errors import InputError
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.setup import RobotSetup
from pps_vision.robot.skin import Skin
from pps_vision.types import Activation, Array, JointVelocity, Mask, Reachability, StereoFrame, TaxelEvents, Track3D
from tracking import kalman
from tracking.kalman import KalmanParams
from tracking.tracker import Tracker, TrackerStep

_LARGEST = 1e6  # m and m/s: what is farther or faster is no measurement


@dataclass(frozen=True)
class PipelineParams:
    """Parameters of everything after the tracker."""

    hold_s: float = MAX_HOLD_S
    """Time for which a command may be held if no later one comes."""
    latency_s: float = 0.0
    """Time from a frame's stamp until its command takes effect; target and posture are predicted to then."""
    search_for_s: float = 30.0
    """Duration of the gaze search after the object was lost; the covering search sees every point that gaze can be on
    within it, what is 8 cm or more before the eyes within half of it."""
    max_false_positives: float = 1e-3
    """Share of the unreachable gaze postures that the map may call reachable (J asks for few)."""
    receptive_field: ReceptiveField = ReceptiveField(distance_to="surface")
    """Region in which a taxel perceives the object (R, "Receptive field"); with R's D, to the object's centre, the
    activation at the touch would depend on the object's size (`bench pps_single_touch`)."""
    fixation: FixationParams | NeckAndEyesParams = FixationParams()
    """Gaze control of a tracked object: J IV.1, or six joints."""
    search: SearchParams = SearchParams()
    """Gaze control after the object was lost (J IV.B)."""
    avoidance: AvoidanceParams = AvoidanceParams(HOME_ARM_RAD)
    """Response of the arm to its skin (R eq. 6)."""
    other_arm: AvoidanceParams | None = None
    """The same of the other arm, if both respond at once; it may only avoid."""
    lean: LeanParams | None = LeanParams()
    """How the torso leans where an arm that reaches is to reach what the map calls unreachable; None: not at all."""
    limits: LimitParams = LimitParams()
    """Limits of every command."""

    @classmethod
    def of(cls, setup: RobotSetup, side: Literal["left", "right"] | None = None) -> "PipelineParams":
        """Parameters for any robot, whose arm of a `side` avoids; by default its first arm."""
        side = side or setup.side
        return cls(avoidance=AvoidanceParams(setup.home_arm(side), side))


@dataclass(frozen=True)
class PipelineState:
    """What one frame hands to the next."""

    learning: LearnerState
    """The PPS memory and the samples since the last contact."""
    arms: tuple[AvoidanceState, ...]
    """Response of each arm under way."""
    leaning: "_Leaning | None" = None
    """The lean under way."""
    searching: SearchState | None = None
    """Gaze search under way."""
    last_known_s: float = -np.inf
    """Stamp of the last frame in which the object was known."""
    last_taxels: tuple[float, Array] | None = None
    """Stamp and taxel positions (n, 3) in the root frame of the last frame."""
    commands: tuple[JointVelocity, ...] = ()
    """Those that may still be obeyed; the last is the last frame's."""
    last_q_rad: Array | None = None
    """Joints (n_joints,) at which the last command was to take effect."""


@dataclass(frozen=True, slots=True)
class PipelineStep:
    """All results of one frame; `reachability` is None without a reachable-space map."""

    posture: Posture
    tracking: TrackerStep
    events: TaxelEvents
    activation: Activation
    reachability: Reachability | None
    responses: tuple[avoidance.Response, ...]
    command: JointVelocity

    @property
    def response(self) -> avoidance.Response:
        """Response of the arm of `PipelineParams.avoidance`; the second of `responses` is the other arm's, if any."""
        return self.responses[0]


class _Leaning(NamedTuple):
    """A torso that leans towards an object, or back."""

    home_rad: Array
    """The torso's joints before it leaned."""
    back: bool = False
    """Whether it returns there."""


class _Arm(NamedTuple):
    """One arm that responds to its skin."""

    params: AvoidanceParams
    skin: Skin
    on_arm: Mask
    """(n,) which of the robot's taxels it carries."""
    bare_links: BareLinks


class Pipeline:
    """Tracker, learner and controllers of one robot; `step` turns a frame into joint velocities.

    Each contact reported to it is learned into its `memory`.  With a reachable-space map (`ReachableMap.load` reads
    what `pps-vision reach train` writes) each step says whether the tracked object is reachable.  `behaviour="reach"`
    requires a map of the arm's side.
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
        check_memory(memory, skin)
        side, map_side = params.avoidance.side, reachable_map.side if reachable_map else "no arm"
        other = params.other_arm
        if other is not None and (other.side == side or other.behaviour != "avoid"):
            raise InputError(
                "pipeline", f"other arm {other.side}, to {other.behaviour}; expected one to avoid, not {side}"
            )
        if params.avoidance.behaviour == "reach" and map_side != side:
            raise InputError(
                "pipeline", f"reachable-space map of {map_side}; expected one of the {side} arm, which is to reach"
            )
        self.params, self.robot, self.skin, self.tracker, self._rng = params, robot, skin, tracker, rng
        self._arms = [self._arm(one) for one in (params.avoidance, other) if one is not None]
        self._reachability: TrackReachability | None = None
        if reachable_map is not None:
            self._reachability = TrackReachability(robot, reachable_map, params.max_false_positives)
        self._self_collision = SelfCollision(robot)
        self._state = PipelineState(LearnerState(memory, EventBuffer()), (AvoidanceState(),) * len(self._arms))

    def step(self, frame: StereoFrame, touched: Mask | None = None) -> PipelineStep:
        """Process one frame and the taxels `touched` (n,) that the skin reports with it.

        Raises:
            InputError: The frame has no joints, or the images or `touched` do not fit this robot; the state is
                unchanged.
        """
        params, state, stamp_s = self.params, self._state, frame.stamp_s
        touched = self._checked(touched)
        posture = self.robot.at(joints_of(frame))
        taxels, normals = self.skin.at(posture)
        then = self._posture_then(posture, stamp_s)
        tracking = self.tracker.step(frame)
        track = tracking.track
        check_track(track)
        moving = _velocity(state.last_taxels, stamp_s, taxels)
        events = self._perceive(track, taxels, normals, moving, touched)
        learned = learner.step(state.learning, events)
        field = params.receptive_field
        probability = activation_by(field, learned.memory, track, taxels, normals, moving)
        active = Activation(stamp_s, self.skin.taxel_ids, probability)
        reachability = self._reachability(posture.q_rad, track) if self._reachability else None
        may_reach = reachability is not None and reachability.is_reachable
        leaning, torso_command = self._lean(state, then, active, may_reach, track, touched)
        found = [
            avoidance.step(
                one.params if leaning is None else replace(one.params, path_m=np.inf, come_m=0.0),
                before,
                then,
                one.skin,
                self._wanted(one, active, leaning, then, track),
                stamp_s,
                may_reach,
                params.hold_s,
                self._self_collision,
                track,
                one.bare_links,
            )
            for one, before in zip(self._arms, state.arms, strict=True)
        ]
        arms, arm_commands, responses = zip(*found, strict=True)
        searching, gaze_command = self._move_gaze(state, then, track)
        last_known_s = stamp_s if track.is_known else state.last_known_s
        wanted = arbiter.combine((*arm_commands, torso_command, gaze_command))
        last = self._last_command, state.last_q_rad
        command = limits.limit(params.limits, self._self_collision, then, wanted, *last)
        since_s = stamp_s - params.latency_s - MAX_HOLD_S
        commands = (*(one for one in state.commands if one.stamp_s > since_s), command)
        since = searching, last_known_s, (stamp_s, taxels), commands, then.q_rad
        self._state = PipelineState(learned, arms, leaning, *since)
        return PipelineStep(posture, tracking, events, active, reachability, responses, command)

    def finish(self) -> PPSMemory:
        """Learn a contact that is still going on, and return the memory."""
        self._state = replace(self._state, learning=learner.finish(self._state.learning))
        return self.memory

    def miss(self) -> PPSMemory:
        """Learn that what came near since the last contact has touched nothing, and return the memory."""
        self._state = replace(self._state, learning=learner.miss(self._state.learning))
        return self.memory

    @property
    def memory(self) -> PPSMemory:
        """What has been learned so far."""
        return self._state.learning.memory

    @property
    def rejected(self) -> dict[str, int]:
        """Number of samples and contacts that were not learned, by reason."""
        return {"stale samples": self._state.learning.stale, "unseen touches": self._state.learning.unseen}

    @property
    def _last_command(self) -> JointVelocity | None:
        return self._state.commands[-1] if self._state.commands else None

    def _posture_then(self, posture: Posture, stamp_s: float) -> Posture:
        """Where the robot will be when this frame's command takes effect."""
        latency_s = self.params.latency_s
        if latency_s == 0:
            return posture
        until_s = stamp_s + latency_s
        return self.robot.at(posture_after(posture.q_rad, self._state.commands, stamp_s, until_s, latency_s))

    def _checked(self, touched: Mask | None) -> Mask:
        n = len(self.skin.taxel_ids)
        if touched is None:
            return np.zeros(n, bool)
        if touched.shape != (n,):
            raise InputError("pipeline", f"touched {touched.shape}; expected the skin's {n} taxels")
        return touched

    def _perceive(
        self, track: Track3D, taxels: Array, normals: Array, taxel_velocity: Array, touched: Mask
    ) -> TaxelEvents:
        """D and TTC (R eqs 1 and 2) of the track for every taxel, NaN without a track.

        TTC is the sooner of two: with the taxel's own velocity, and with the taxel at rest, so that the activation
        stays while the arm withdraws.
        """
        D, ttc = np.full((2, len(taxels)), np.nan)
        if track.is_known:
            stimulus = track.position, track.velocity, track.radius_m, track.cov[3:6, 3:6]
            velocities = np.stack([np.zeros_like(taxel_velocity), taxel_velocity])
            both = perceive(self.params.receptive_field, taxels, normals, *stimulus, velocities)
            D, ttc = both[0][0], sooner(*both[1])
        return TaxelEvents(track.stamp_s, self.skin.taxel_ids, D, ttc, touched)

    def _arm(self, params: AvoidanceParams) -> _Arm:
        n = len(self.robot.names.arm(params.side))
        if len(params.home_arm_rad) != n:
            found = f"home_arm_rad {params.home_arm_rad}"
            raise InputError("pipeline", f"{found}; expected the {n} joints of the {params.side} arm")
        skin = self.skin.on_arm(self.robot, params.side)
        on_arm = np.isin(self.skin.taxel_ids, skin.taxel_ids)
        return _Arm(params, skin, on_arm, BareLinks(self.robot, skin, params.side))

    def _lean(
        self, state: PipelineState, posture: Posture, active: Activation, may_reach: bool, track: Track3D, touched: Mask
    ) -> tuple[_Leaning | None, JointVelocity]:
        """Lean until an object that the arm is to reach for is reachable; back when it is touched, lost, or cannot be.

        The map is asked: what it calls reachable may still be touched by a part before the hand is there.
        """
        params, arm, found, leaning = self.params.lean, self._arms[0], self._reachability, state.leaning
        still = self._still(track.stamp_s)
        torso = self.robot.indices(self.robot.names.torso)
        if params is None or found is None or not torso or arm.params.behaviour != "reach":
            return None, still
        if leaning is None:
            is_active = bool(np.any(active.probability[arm.on_arm] > arm.params.threshold))
            if may_reach or not is_active:  # without a track nothing is active
                return None, still
            leaning = _Leaning(posture.q_rad[torso])
        elif not track.is_known or touched[arm.on_arm].any():
            leaning = leaning._replace(back=True)
        if leaning.back:
            command = lean.upright(params, posture, leaning.home_rad, self.params.hold_s, track.stamp_s)
            return (leaning if np.any(command.dq_rad_s) else None), command
        if may_reach:
            return leaning, still
        of, wanted = (found.gaze_model, found.map.limits, found.reachable), (posture, track.position)
        status, command = lean.step(params, *of, *wanted, self.params.hold_s, track.stamp_s)
        return leaning._replace(back=status == "out of reach"), command

    def _wanted(
        self, arm: _Arm, active: Activation, leaning: _Leaning | None, posture: Posture, track: Track3D
    ) -> Array:
        """Activations (n,) that an arm responds to: those of its taxels; and that of the palm's taxel (of any, if it
        has none) nearest to an object that the torso leans for counts as 1, as the object need not be near."""
        probability = active.probability[arm.on_arm]
        if leaning is None or leaning.back or arm is not self._arms[0]:
            return probability
        palm = self.robot.names.palm(arm.params.side)
        of_palm = [part.frame == palm for part in arm.skin.parts]
        distance = np.linalg.norm(arm.skin.at(posture)[0] - track.position, axis=1)
        if any(of_palm):
            distance[~np.array(of_palm)[arm.skin.part_index]] = np.inf
        probability = probability.copy()
        probability[distance.argmin()] = 1.0
        return probability

    def _move_gaze(
        self, state: PipelineState, posture: Posture, track: Track3D
    ) -> tuple[SearchState | None, JointVelocity]:
        """Fixate a known object, search for `search_for_s` after it was lost, otherwise keep still; as fixed cameras
        always do."""
        params, stamp_s = self.params, track.stamp_s
        if not self.robot.names.gaze_joints:
            return None, self._still(stamp_s)
        if track.is_known:
            p, v = kalman.extrapolate(KalmanParams(), track, params.latency_s, self._since_last(stamp_s))
            v = v - self._carried(posture, p, stamp_s)
            target = posture, p, v, params.hold_s, stamp_s
            if isinstance(params.fixation, NeckAndEyesParams):
                return None, neck_and_eyes.step(params.fixation, *target, self._last_command)
            return None, fixation.step(params.fixation, *target)
        if stamp_s - state.last_known_s < params.search_for_s:
            searching = state.searching or SearchState(gaze_of(posture))
            return search.step(params.search, searching, posture, params.hold_s, self._rng, stamp_s)
        return None, self._still(stamp_s)

    def _still(self, stamp_s: float) -> JointVelocity:
        return JointVelocity(stamp_s, np.zeros(self.robot.n_joints), self.params.hold_s)

    def _carried(self, posture: Posture, p_root: Array, stamp_s: float) -> Array:
        """(3,) m/s velocity of a point that moves with the trunk, as that has turned since the last frame."""
        elapsed_s, q = self._since_last(stamp_s), self._state.last_q_rad
        if q is None or elapsed_s == 0:
            return np.zeros(3)
        return carried_velocity(posture, p_root, (posture.q_rad - q) / elapsed_s)

    def _since_last(self, stamp_s: float) -> float:
        """Time since the last frame; 0 where there is none, or too long ago."""
        last = self._last_command
        return stamp_s - last.stamp_s if last is not None and stamp_s <= last.stamp_s + MAX_HOLD_S else 0.0


class TrackActivation:
    """Activation of a robot's skin by what is tracked, frame by frame, as in `Pipeline`, of a memory that stays."""

    def __init__(self, robot: Robot, skin: Skin, memory: PPSMemory) -> None:
        """The memory is one of this skin (`check_memory`)."""
        self.robot, self.skin, self.memory = robot, skin, memory
        self._last: tuple[float, Array] | None = None

    def __call__(self, q_rad: Array, track: Track3D) -> tuple[Activation, Array]:
        """Activation by a track, and the taxels' positions (n, 3), in the root frame with the robot at configuration
        `q_rad` (n_joints,); frames come in the order of time."""
        taxels, normals = self.skin.at(self.robot.at(q_rad))
        moving, self._last = _velocity(self._last, track.stamp_s, taxels), (track.stamp_s, taxels)
        field = PipelineParams.receptive_field
        probability = activation_by(field, self.memory, track, taxels, normals, moving)
        return Activation(track.stamp_s, self.skin.taxel_ids, probability), taxels


def check_memory(memory: PPSMemory, skin: Skin, source: Path | str = "pipeline") -> None:
    """InputError, naming the source, unless the memory has exactly the skin's taxels."""
    if memory.taxel_ids != skin.taxel_ids:
        n, m = len(memory.taxel_ids), len(skin.taxel_ids)
        raise InputError(source, f"memory has {n} taxels but the skin has {m}; expected a memory of this skin")


def check_track(track: Track3D) -> None:
    """InputError for a known track whose position, velocity or velocity covariance cannot be acted on."""
    if not track.is_known:
        return
    motion, cov = track.mean[:2], track.cov[3:6, 3:6]
    if not np.all(np.abs(motion) < _LARGEST):
        raise InputError("pipeline", f"track at {motion[0]} m moving {motion[1]} m/s; expected finite numbers")
    if not np.isfinite(cov).all() or (variances := np.linalg.eigvalsh(cov))[0] < -1e-9 * variances[-1]:
        raise InputError("pipeline", f"velocity covariance {cov.tolist()}; expected a positive semi-definite one")


def joints_of(frame: StereoFrame) -> Array:
    """(n_joints,) rad, the mean of the joints at the two images, which is that at the frame's stamp.

    Raises:
        InputError: The frame has no joints.
    """
    if frame.joints_left_rad is None or frame.joints_right_rad is None:
        raise InputError("pipeline", "frame without joints; expected a robot's recording")
    joints: Array = 0.5 * (frame.joints_left_rad + frame.joints_right_rad)
    return joints


def activation_by(
    field: ReceptiveField, memory: PPSMemory, track: Track3D, taxels: Array, normals: Array, taxel_velocity: Array
) -> Array:
    """(n,) activation of every taxel, its mean over the velocities that the track may have; 0 without a track.

    Positions, unit normals and velocities of the taxels are (n, 3) in the root frame.
    """
    if not track.is_known:
        return np.zeros(len(taxels))
    stimulus = track.position, track.velocity, track.radius_m, None
    likely = likely_velocities(taxels, track.position, track.cov[3:6, 3:6])
    velocities = np.stack([likely, taxel_velocity + likely])
    D, ttc = perceive(field, taxels, normals, *stimulus, velocities)
    mean: Array = activation(memory, D[0], sooner(*ttc)).mean(axis=0)
    return mean


def sooner(a: Array, b: Array) -> Array:
    """The smaller of two times to contact where both are ahead (≥ 0), the one that is, or else `b`."""
    return np.where(a >= 0, np.where(b >= 0, np.minimum(a, b), a), b)


def _velocity(last: tuple[float, Array] | None, stamp_s: float, positions: Array) -> Array:
    """(n, 3) m/s of the taxels since the last frame, 0 where there is none or its stamp is not earlier."""
    if last is None or stamp_s <= last[0]:
        return np.zeros_like(positions)
    return (positions - last[1]) / (stamp_s - last[0])
