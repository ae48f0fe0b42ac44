"""One stereo frame through the whole robot: tracker, skin, reachable space, arms and gaze.

Rendered and recorded frames take the same steps; a recording does not obey the commands.

Of several tracked objects, each taxel is activated by the one that most probably touches it.  The gaze, the learner and
the reachable-space map attend to the one with the highest activation of all; an arm that avoids responds to the one
with the highest activation of its own taxels.  Of two arms that reach, the one whose map states the higher degree R
does with its palm, whichever feels the object.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from control import avoidance, fixation, lean, limits, neck_and_eyes, reaching, search
from control.avoidance import ArmInput, ArmState, AvoidanceParams, Response
from control.commands import MAX_LATE_S, Prediction, combine, posture_after, predict
from control.fixation import FixationParams
from control.head import carried_velocity, gaze_of
from control.lean import LeanParams
from control.limits import MAX_HOLD_S, LimitParams
from control.neck_and_eyes import NeckAndEyesParams
from control.reaching import ReachingParams
from control.search import SearchParams, SearchState
from learning.pps import learner
from learning.pps.learner import LearnerState, SkinFrame, SkinStep
from learning.pps.memory import PPSMemory
from learning.pps.receptive_field import CONE, NEAR, ReceptiveField
from learning.reach.map import ReachableMap, TrackReachability
from pps_vision.errors import InputError
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Activation, Array, JointVelocity, Mask, Reachability, StereoFrame, TaxelEvents, Track3D
from tracking import kalman
from tracking.kalman import KalmanParams
from tracking.tracker import Tracker, TrackerStep

_MAX_MAGNITUDE = 1e6  # m and m/s: larger values are no measurement
_RETRY_M = 0.05  # a hand that did not arrive tries again once the object has moved by this
_PROGRESS_M = 0.01  # a hand that has come no nearer than this within the time below does not arrive
_STALLED_S = 1.5


@dataclass(frozen=True)
class PipelineParams:
    """Parameters of everything after the tracker."""

    hold_s: float = MAX_HOLD_S
    """Time for which a command may be held if no later one comes."""
    latency_s: float = 0.0
    """Time from a frame's stamp until its command takes effect; target and posture are predicted to then."""
    encoder_noise_rad: float = float(np.deg2rad(0.1))
    """Largest difference of two readings of a joint at rest (iCub: two steps of 0.05°); where the robot repeatedly
    differs from the prediction by more, it does not obey, or the latency or the readings' age is not the stated one."""
    search_for_s: float = 30.0
    """Duration of the gaze search after the object was lost; the covering search sees every point that can be fixated
    within this time, points at least 8 cm before the eyes within half of it."""
    max_false_positives: float = 1e-3
    """Largest share of the unreachable gaze postures that the map calls reachable (J asks for few)."""
    attention_margin: float = 0.1
    """The object with the highest activation is attended instead of another activated one if it exceeds that one's by
    this much; while no activation is that high, the tracker decides."""
    receptive_field: ReceptiveField = NEAR
    """Region in which a taxel with our memory perceives the object; with R's map R's cone.  With R's D, to the object's
    centre, the activation at the touch would depend on the object's size."""
    fixation: FixationParams | NeckAndEyesParams = FixationParams()
    """Gaze control of a tracked object: J IV.1, or six joints."""
    search: SearchParams = SearchParams()
    """Gaze control after the object was lost (J IV.B)."""
    arm: AvoidanceParams | ReachingParams = AvoidanceParams(HOME_ARM_RAD)
    """Response of the arm to its skin: it avoids the object or reaches for it."""
    other_arm: AvoidanceParams | ReachingParams | None = None
    """Response of the other arm; None: it keeps still."""
    hand_margin: float = 0.1
    """Of two hands that reach, the one chosen last stays unless it no longer reaches the object, or the other's degree
    R is higher by this much."""
    lean: LeanParams | None = LeanParams()
    """Lean of the torso towards an object that the arm is to reach for and the map calls unreachable; None: no lean."""
    limits: LimitParams = LimitParams()
    """Limits of every command."""

    @classmethod
    def of(cls, setup: RobotSetup, side: Literal["left", "right"] | None = None) -> "PipelineParams":
        """Parameters for any robot, whose arm of a `side` avoids; by default its first arm."""
        side = side or setup.side
        return cls(arm=AvoidanceParams(setup.home_arm(side), side))


@dataclass(frozen=True)
class PipelineState:
    """State carried from frame to frame."""

    learning: LearnerState  # the PPS memory and the samples since the last contact
    arms: tuple[ArmState, ...]  # state of each arm that responds
    leaning: "_Leaning | None" = None  # the lean under way
    searching: SearchState | None = None  # gaze search under way
    last_known_s: float = -np.inf  # stamp of the last frame in which the object was known
    hand: int = 0  # number of the map asked last, that of the hand to reach with
    attempt: "_Attempt" = field(default_factory=lambda: _Attempt({}))  # the hands' reach for the attended object
    attended_id: int = 0  # track attended in the last frame
    highest: Mapping[int, float] = field(default_factory=dict)  # highest activation by each track then known
    commands: tuple[JointVelocity, ...] = ()  # commands that may still be obeyed; the last is the last frame's
    last_q_rad: Array | None = None  # reported joints (n_joints,), extrapolated to when the last command took effect
    prediction: Prediction | None = None  # the same by the commands alone


@dataclass(frozen=True, slots=True)
class PipelineStep:
    """All results of one frame; `reachability` is None without a reachable-space map, with two that of the hand chosen.

    `tracking` is the step of the attended object, by its activation; the others are in it.
    """

    posture: Posture
    tracking: TrackerStep
    events: TaxelEvents
    activation: Activation
    reachability: Reachability | None
    responses: tuple[Response, ...]
    command: JointVelocity
    mismatch_rad: float
    """Largest difference of a joint from its prediction that two frames of the last second show; 0: within noise."""

    @property
    def response(self) -> Response:
        """Response of `PipelineParams.arm`; the second of `responses` is that of `other_arm`, if any."""
        return self.responses[0]


class _Leaning(NamedTuple):
    """A torso that leans towards an object, or back."""

    home_rad: Array  # the torso's joints before the lean
    is_returning: bool = False  # whether the torso turns back to them


class _Attempt(NamedTuple):
    """What came of reaching for an object."""

    missed: Mapping[int, Array]  # where the object (3,) m was that a hand did not reach, by hand
    nearest_m: float = np.inf  # smallest distance of the palm in the reach under way
    nearest_s: float = -np.inf  # its stamp
    has_touched: bool = False  # whether the reach under way has touched anything


class _Arm(NamedTuple):
    """An arm that responds to its skin."""

    params: AvoidanceParams | ReachingParams
    skin: Skin
    on_arm: Mask  # (n,) which of the robot's taxels it carries
    palm: Mask  # (k,) which of its taxels are the palm's; all, if the palm has none
    bare_links: BareLinks


class _ControlInput(NamedTuple):
    """Input of all controllers in one frame."""

    posture: Posture  # the robot when the command takes effect
    track: Track3D  # the attended object
    felt: SkinStep  # activations of the taxels by the known objects
    touched: Mask
    is_reachable: bool  # whether the reachable-space map calls the object reachable; False without a map
    hand: int  # number of the hand to reach with
    is_felt: bool  # whether a taxel of an arm that reaches is activated


class Pipeline:
    """Tracker, learner and controllers of one robot; `step` turns a frame into joint velocities.

    Every contact passed to `step` updates `memory`.  With a reachable-space map (`ReachableMap.load` reads the file of
    `pps-vision reach train`) each step says whether the tracked object is reachable.  `ReachingParams` require a map of
    the arm's side, given as either map.
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
        other_map: ReachableMap | None = None,
    ) -> None:
        check_memory(memory, skin, robot=robot)
        skin = memory.skin_of(skin)
        side = params.arm.side
        if params.other_arm is not None and params.other_arm.side == side:
            raise InputError("pipeline", f"other arm {side}; expected the arm that is not {side}")
        self.params = params
        self.robot = robot
        self.skin = skin
        self.tracker = tracker
        self._rng = rng
        self._arms = [self._arm(arm) for arm in (params.arm, params.other_arm) if arm is not None]
        self._hands = [arm for arm in self._arms if isinstance(arm.params, ReachingParams)]
        maps = {learned.side: learned for learned in (reachable_map, other_map) if learned is not None}
        for hand in self._hands:
            if (side := hand.params.side) not in maps:
                given = " and ".join(maps) or "no arm"
                raise InputError("pipeline", f"reachable-space map of {given}; expected one of the {side} arm")
            if not hand.skin.parts:
                raise InputError("pipeline", f"no taxels on the {side} arm; expected some to reach with")
        asked = [maps[hand.params.side] for hand in self._hands] or list(maps.values())
        self._reachability = [TrackReachability(robot, learned, params.max_false_positives) for learned in asked]
        self._self_collision = SelfCollision(robot)
        self._state = PipelineState(LearnerState(memory), (ArmState(),) * len(self._arms))

    def step(self, frame: StereoFrame, touched: Mask | None = None) -> PipelineStep:
        """Process one frame and the taxels `touched` (n,) that the skin, not a tool, reports with it.

        InputError if the frame has no joints, or the images or `touched` do not fit this robot; the state is unchanged.
        """
        params = self.params
        state = self._state
        stamp_s = frame.stamp_s
        n_places = len(self.memory.places)
        n = len(self.skin.taxel_ids) - n_places
        touched = np.zeros(n, bool) if touched is None else touched
        if touched.shape != (n,):
            raise InputError("pipeline", f"touched {touched.shape}; expected the skin's {n} taxels")
        touched = np.append(touched, np.zeros(n_places, bool))
        frame = with_offsets(frame, state.learning.memory.offsets_rad)
        posture = self.robot.at(joints_of(frame))
        tracking = self.tracker.step(frame)
        for track in tracking.tracks:
            check_track(track, stamp_s)
        tracking = attend(tracking, state.highest, state.attended_id, params.attention_margin)
        track = tracking.track
        parts = self.skin.taxel_ids, *self.skin.at(posture), touched
        skin = SkinFrame(stamp_s, *parts, tracking.tracks, track.track_id, self.skin.margins)
        field = params.receptive_field if state.learning.memory.params.knows_path else CONE
        learned, felt = learner.step(field, state.learning, skin)
        hand, reachability, is_reachable = self._choose_hand(posture.q_rad, track)
        at_effect = posture  # of this frame's command
        if latency_s := params.latency_s:
            q_rad = posture_after(posture.q_rad, state.commands, stamp_s, stamp_s + latency_s, latency_s)
            at_effect = self.robot.at(q_rad)
        is_felt = any(np.any(felt.activation.probability[arm.on_arm] > arm.params.threshold) for arm in self._hands)
        inputs = _ControlInput(at_effect, track, felt, touched, is_reachable, hand, is_felt)
        leaning, torso_command = self._lean(state.leaning, inputs)
        arms, responses = self._move_arms(state.arms, leaning, inputs)
        searching, gaze_command = self._move_gaze(state, inputs)
        wanted = combine([*(response.command for response in responses), torso_command, gaze_command])
        last_q = state.prediction.q_rad if state.prediction else None
        command = limits.limit(params.limits, self._self_collision, at_effect, wanted, self._last_command, last_q)
        prediction = predict(state.prediction, state.commands, posture.q_rad, at_effect.q_rad, stamp_s)
        repeated_rad = prediction.repeated_rad
        mismatch_rad = repeated_rad if repeated_rad > params.encoder_noise_rad else 0.0
        obeyed_since_s = stamp_s - params.latency_s - MAX_HOLD_S - MAX_LATE_S
        self._state = PipelineState(
            learning=learned,
            arms=arms,
            leaning=leaning,
            searching=searching,
            last_known_s=stamp_s if track.is_known else state.last_known_s,
            hand=hand,
            attempt=self._attempted(arms, inputs),
            attended_id=track.track_id,
            highest=highest_by_track(felt.tracks, felt.by_track),
            commands=(*(earlier for earlier in state.commands if earlier.stamp_s > obeyed_since_s), command),
            last_q_rad=at_effect.q_rad,
            prediction=prediction,
        )
        return PipelineStep(
            posture, tracking, felt.events, felt.activation, reachability, responses, command, mismatch_rad
        )

    def finish(self) -> PPSMemory:
        """Learn from a contact that has not ended; return the memory."""
        self._state = replace(self._state, learning=learner.finish(self._state.learning))
        return self.memory

    def miss(self) -> PPSMemory:
        """Learn that the samples since the last contact led to no touch; return the memory."""
        self._state = replace(self._state, learning=learner.miss(self._state.learning))
        return self.memory

    @property
    def memory(self) -> PPSMemory:
        """The memory after the last frame."""
        return self._state.learning.memory

    @property
    def rejected(self) -> dict[str, int]:
        """Number of rejected samples and contacts, by reason."""
        return {"stale samples": self._state.learning.stale, "unseen touches": self._state.learning.unseen}

    @property
    def _last_command(self) -> JointVelocity | None:
        return self._state.commands[-1] if self._state.commands else None

    def _arm(self, params: AvoidanceParams | ReachingParams) -> _Arm:
        n = len(self.robot.names.arm(params.side))
        if len(params.home_arm_rad) != n:
            expected = f"the {n} joints of the {params.side} arm"
            raise InputError("pipeline", f"home_arm_rad {params.home_arm_rad}; expected {expected}")
        skin = self.skin.on_arm(self.robot, params.side)
        on_arm = np.isin(self.skin.taxel_ids, skin.taxel_ids)
        frame = self.robot.names.palm(params.side)
        palm = np.array([skin.parts[k].frame == frame for k in skin.part_index], dtype=bool)
        return _Arm(params, skin, on_arm, palm if palm.any() else ~palm, BareLinks(self.robot, skin, params.side))

    def _choose_hand(self, q_rad: Array, track: Track3D) -> tuple[int, Reachability | None, bool]:
        """The number of the map of the hand to reach with, its answer, and whether it may reach. Hands that reach
        the object and have not missed it come first, then the highest degree R."""
        answers = [reachability(q_rad, track) for reachability in self._reachability]
        if not answers:
            return 0, None, False
        last = self._state.hand
        margins = self.params.hand_margin * (np.arange(len(answers)) == last)
        degrees = np.nan_to_num([answer.degree for answer in answers]) + margins
        missed = self._state.attempt.missed
        may_reach = [answer.is_reachable and k not in missed for k, answer in enumerate(answers)]
        chosen = max(range(len(answers)), key=lambda k: (may_reach[k], degrees[k]))
        return chosen, answers[chosen], may_reach[chosen]

    def _attempted(self, arms: tuple[ArmState, ...], inputs: _ControlInput) -> _Attempt:
        """The attempt after this frame, in which the arms have moved on to their states.

        A hand misses an object that it stops before or turns back from untouched, where something is in its way, such
        as the other arm; the other hand may then reach it, or the torso turn for it.
        """
        track = inputs.track
        if not (self._hands and track.is_known):
            return _Attempt({})
        last = self._state.attempt
        missed = {k: p for k, p in last.missed.items() if np.linalg.norm(track.position - p) < _RETRY_M}
        arm = self._hands[inputs.hand]
        number = self._arms.index(arm)
        was_reaching, is_reaching = (states[number].mode == "reach" for states in (self._state.arms, arms))
        if not (was_reaching or is_reaching):
            return _Attempt(missed)
        attempt = last if was_reaching and inputs.hand == self._state.hand else _Attempt(missed)
        has_touched = attempt.has_touched or bool(inputs.touched[arm.on_arm].any())
        palm = arm.skin.at(inputs.posture)[0][arm.palm]
        gap_m = float(np.linalg.norm(palm - track.position, axis=1).min())
        nearest = attempt.nearest_m, attempt.nearest_s
        if gap_m < attempt.nearest_m - _PROGRESS_M:
            nearest = gap_m, track.stamp_s
        is_over = not is_reaching or track.stamp_s - nearest[1] > _STALLED_S
        if was_reaching and is_over and inputs.is_reachable and not has_touched:
            missed[inputs.hand] = track.position
        return _Attempt(missed, *nearest, has_touched) if is_reaching else _Attempt(missed)

    def _lean(self, leaning: _Leaning | None, inputs: _ControlInput) -> tuple[_Leaning | None, JointVelocity]:
        """Lean until an object that the arm is to reach for is reachable; back when it is touched, lost, or cannot be.

        The map alone decides: an object that it calls reachable may be touched by another part than the palm first.
        """
        params = self.params.lean
        track = inputs.track
        still = self._still(track.stamp_s)
        torso = self.robot.indices(self.robot.names.torso)
        if params is None or not self._hands or not torso:
            return None, still
        arm = self._hands[inputs.hand]
        if leaning is None:
            is_wanted = inputs.is_felt or self._state.attempt.missed  # without a track nothing is felt
            if inputs.is_reachable or not is_wanted:
                return None, still
            leaning = _Leaning(inputs.posture.q_rad[torso])
        elif not track.is_known or inputs.touched[arm.on_arm].any():
            leaning = leaning._replace(is_returning=True)
        if leaning.is_returning:
            command = lean.upright(params, inputs.posture, leaning.home_rad, self.params.hold_s, track.stamp_s)
            return (leaning if np.any(command.dq_rad_s) else None), command
        if inputs.is_reachable:
            return leaning, still
        reachability = self._reachability[inputs.hand]
        reachable_space = reachability.gaze_model, reachability.map.limits, self._reachable_by_any
        target = track.position, self.params.hold_s, track.stamp_s
        status, command = lean.step(params, *reachable_space, inputs.posture, *target)
        return leaning._replace(is_returning=status == "out of reach"), command

    def _reachable_by_any(self, gaze: Array) -> Mask:
        """The verdict (n,) of the maps on gaze postures (n, 3): whether any hand may be sent there that has not missed
        the object."""
        hands = [answer for k, answer in enumerate(self._reachability) if k not in self._state.attempt.missed]
        return np.any([np.zeros(len(gaze), bool), *(hand.reachable(gaze) for hand in hands)], axis=0)

    def _move_arms(
        self, states: tuple[ArmState, ...], leaning: _Leaning | None, inputs: _ControlInput
    ) -> tuple[tuple[ArmState, ...], tuple[Response, ...]]:
        """Advance every arm."""
        next_states = []
        responses = []
        for arm, state in zip(self._arms, states, strict=True):
            params = arm.params
            activations = self._arm_activations(arm, leaning, inputs)
            body = self._self_collision, arm.bare_links
            arm_input = ArmInput(
                inputs.track.stamp_s, inputs.posture, arm.skin, activations, inputs.track, self.params.hold_s, *body
            )
            if isinstance(params, ReachingParams):
                may_reach = partial(self._may_reach, arm, inputs)
                state, response = reaching.step(params, state, arm_input, may_reach, arm.palm)
            else:
                arm_input = replace(arm_input, track=self._threat(arm, state, inputs))
                state, response = avoidance.step(params, state, arm_input)
            next_states.append(state)
            responses.append(response)
        return tuple(next_states), tuple(responses)

    def _may_reach(self, arm: _Arm, inputs: _ControlInput, taxel: int) -> bool:
        """Whether an arm is the one to reach with, and its map calls the object reachable, with any taxel."""
        return inputs.is_reachable and arm is self._hands[inputs.hand]

    def _threat(self, arm: _Arm, state: ArmState, inputs: _ControlInput) -> Track3D:
        """The object that most activates an arm's taxels, the attended one if none does."""
        highest = highest_by_track(inputs.felt.tracks, inputs.felt.by_track[:, arm.on_arm])
        chosen_id = most_activated(highest, state.track_id, self.params.attention_margin)
        return next((track for track in inputs.felt.tracks if track.track_id == chosen_id), inputs.track)

    def _arm_activations(self, arm: _Arm, leaning: _Leaning | None, inputs: _ControlInput) -> Array:
        """Activations (k,) of an arm's taxels.

        While the torso leans towards an object, or an arm that reaches feels it or has missed it, the nearest taxel of
        the palm to reach with counts as fully activated: the object need not be near.
        """
        probability = inputs.felt.activation.probability[arm.on_arm]
        is_leaning = leaning is not None and not leaning.is_returning
        if not (is_leaning or inputs.is_felt or self._state.attempt.missed) or arm is not self._hands[inputs.hand]:
            return probability
        distance = np.linalg.norm(arm.skin.at(inputs.posture)[0] - inputs.track.position, axis=1)
        probability = probability.copy()
        probability[np.where(arm.palm, distance, np.inf).argmin()] = 1.0
        return probability

    def _move_gaze(self, state: PipelineState, inputs: _ControlInput) -> tuple[SearchState | None, JointVelocity]:
        """Fixate a known object; search for `search_for_s` after it was lost; otherwise, and with fixed cameras, keep
        still."""
        params = self.params
        track = inputs.track
        stamp_s = track.stamp_s
        if not self.robot.names.gaze_joints:
            return None, self._still(stamp_s)
        if track.is_known:
            elapsed_s = self._since_last(stamp_s)
            p, v = kalman.extrapolate(KalmanParams(), track, params.latency_s, elapsed_s)
            if elapsed_s and state.last_q_rad is not None:  # a point that moves with the trunk stays in the gaze
                v = v - carried_velocity(inputs.posture, p, (inputs.posture.q_rad - state.last_q_rad) / elapsed_s)
            target = inputs.posture, p, v, params.hold_s, stamp_s
            if isinstance(params.fixation, NeckAndEyesParams):
                return None, neck_and_eyes.step(params.fixation, *target, self._last_command)
            return None, fixation.step(params.fixation, *target)
        if stamp_s - state.last_known_s < params.search_for_s:
            searching = state.searching or SearchState(gaze_of(inputs.posture))
            return search.step(params.search, searching, inputs.posture, params.hold_s, self._rng, stamp_s)
        return None, self._still(stamp_s)

    def _still(self, stamp_s: float) -> JointVelocity:
        return JointVelocity(stamp_s, np.zeros(self.robot.n_joints), self.params.hold_s)

    def _since_last(self, stamp_s: float) -> float:
        """Time since the last frame; 0 where there is none, or too long ago."""
        last = self._last_command
        return stamp_s - last.stamp_s if last is not None and stamp_s <= last.stamp_s + MAX_HOLD_S else 0.0


class TrackActivation:
    """Activation of a robot's skin by tracked objects, frame by frame, as in `Pipeline`, by a memory that stays
    unchanged."""

    def __init__(self, robot: Robot, skin: Skin, memory: PPSMemory) -> None:
        """The memory is one of this skin (`check_memory`)."""
        self.robot = robot
        self.skin = memory.skin_of(skin)
        self.offsets_rad = memory.offsets_rad  # which the joints include already
        self._learning = LearnerState(memory)
        self._attended_id = 0

    def __call__(self, q_rad: Array, tracking: TrackerStep) -> tuple[TrackerStep, Activation, Array]:
        """The tracker's step with the object attended that most activates the skin, the activation, and the taxels'
        positions (n, 3), in the root frame with the robot at configuration `q_rad` (n_joints,); frames come in the
        order of time."""
        stamp_s = tracking.track.stamp_s
        ids = self.skin.taxel_ids
        positions, normals = self.skin.at(self.robot.at(q_rad))
        untouched = np.zeros(len(ids), bool)
        skin = SkinFrame(stamp_s, ids, positions, normals, untouched, tracking.tracks, margins=self.skin.margins)
        field = PipelineParams.receptive_field if self._learning.memory.params.knows_path else CONE
        self._learning, felt = learner.step(field, self._learning, skin)
        highest = highest_by_track(felt.tracks, felt.by_track)
        tracking = attend(tracking, highest, self._attended_id, PipelineParams.attention_margin)
        self._attended_id = tracking.track.track_id
        return tracking, felt.activation, positions


def attend(tracking: TrackerStep, highest: Mapping[int, float], last_id: int, margin: float) -> TrackerStep:
    """The step of the object with the `highest` activation of any taxel, with the others; as the tracker says if none
    is activated.  `last_id`: the track attended in the last frame; `margin`: `PipelineParams.attention_margin`."""
    steps = tracking, *tracking.others
    present = {step.track.track_id: highest.get(step.track.track_id, 0.0) for step in steps if step.track.is_known}
    chosen_id = most_activated(present, last_id, margin)
    chosen = next((step for step in steps if step.track.track_id == chosen_id), tracking)
    if chosen is tracking:
        return tracking
    others = sorted((step for step in steps if step is not chosen), key=lambda step: step.track.track_id)
    return replace(chosen, others=tuple(replace(step, others=()) for step in others))


def most_activated(highest: Mapping[int, float], last_id: int, margin: float) -> int | None:
    """The track with the highest activation, the last one unless it is exceeded by `margin`; None if none is that
    high."""
    best = max(highest, key=highest.__getitem__, default=None)
    if best is None:
        return None
    last = highest.get(last_id, 0.0)
    if last > 0 and highest[best] - last < margin:
        return last_id
    return best if highest[best] >= margin else None


def highest_by_track(tracks: Sequence[Track3D], by_track: Array) -> dict[int, float]:
    """The highest of the activations (m, n) by each of m tracks, by its number."""
    highest = by_track.max(axis=1, initial=0.0).tolist()
    return {track.track_id: value for track, value in zip(tracks, highest, strict=True)}


def check_memory(memory: PPSMemory, skin: Skin, source: Path | str = "pipeline", robot: Robot | None = None) -> None:
    """InputError, naming the source, unless the memory has exactly the skin's taxels and any places beyond it, and any
    offsets are of the robot's joints."""
    own = memory.n_own
    if memory.taxel_ids[:own] != skin.taxel_ids or not np.array_equal(memory.part_index[:own], skin.part_index):
        sizes = f"memory has {own} taxels but the skin has {len(skin.taxel_ids)}"
        raise InputError(source, f"{sizes}; expected a memory of this skin")
    n = len(memory.offsets_rad)
    if robot is not None and n not in (0, robot.n_joints):
        raise InputError(source, f"memory with offsets of {n} joints; expected those of the robot's {robot.n_joints}")


def with_offsets(frame: StereoFrame, offsets_rad: Array) -> StereoFrame:
    """The frame with offsets (n_joints,) added to its joints; without offsets itself."""
    if not len(offsets_rad) or frame.joints_left_rad is None or frame.joints_right_rad is None:
        return frame
    left, right = frame.joints_left_rad + offsets_rad, frame.joints_right_rad + offsets_rad
    return replace(frame, joints_left_rad=left, joints_right_rad=right)


def check_track(track: Track3D, stamp_s: float) -> None:
    """InputError for a track of another frame, or a known one whose derivatives or covariance are unusable."""
    if abs(track.stamp_s - stamp_s) > 0:  # not for a stamp that is no number, which the arm refuses
        raise InputError("pipeline", f"track of {track.stamp_s} s; expected one of the frame, {stamp_s} s")
    if not track.is_known:
        return
    for name, values in zip(("position", "velocity", "acceleration", "jerk"), track.mean, strict=True):
        if not np.all(np.abs(values) < _MAX_MAGNITUDE):
            raise InputError("pipeline", f"track with {name} {values}; expected finite numbers below 1e6")
    if not np.all(np.abs(track.cov) < _MAX_MAGNITUDE**2) or not all(
        map(_is_covariance, (track.cov, track.cov[3:6, 3:6]))
    ):
        variances = np.diag(track.cov)
        raise InputError("pipeline", f"covariance of diagonal {variances}; expected a positive semi-definite one")


def _is_covariance(matrix: Array) -> bool:
    """Whether a symmetric matrix (n, n) has no negative eigenvalue but by rounding."""
    variances = np.linalg.eigvalsh(matrix)
    return bool(variances[0] >= -1e-9 * variances[-1])


def joints_of(frame: StereoFrame) -> Array:
    """(n_joints,) rad at the frame's stamp: the mean of the joints at the two images; InputError without joints."""
    if frame.joints_left_rad is None or frame.joints_right_rad is None:
        raise InputError("pipeline", "frame without joints; expected a robot's recording")
    joints: Array = 0.5 * (frame.joints_left_rad + frame.joints_right_rad)
    return joints
