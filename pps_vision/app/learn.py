"""Learn from recordings in which the skin is touched: PPS maps (`pps_vision.learn`), encoders, places of taxels and of
a tool in the hand; and from motor babbling, in which the eyes see the hand."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from learning.pps.body import LearnedBody, learned_body
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory
from learning.pps.tool import with_tool
from learning.reach.babbling import SeenHand
from learning.reach.forward_model import N_JOINTS
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.progress import progress
from pps_vision.app.track import TrackedRecording, tracker_for, tracker_params
from pps_vision.errors import InputError, expect_kinds
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording, Touch
from pps_vision.robot.gaze import GazeModel
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.model import Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Mask, Observation3D
from tracking import Mode

_MAX_TOUCH_AGE_S = 0.06  # the skin reports every 0.02 to 0.05 s
_FEWEST = 200  # postures, for the 81 coefficients of a coordinate
_REST_RAD = np.deg2rad(1.0)  # largest motion of a joint at rest


@dataclass(frozen=True)
class Learned:
    """The memory after a recording, number of new samples, number of rejected samples by reason, and the touches by the
    tracked object."""

    memory: PPSMemory
    samples: int
    rejected: dict[str, int]
    touches: list[TouchTrial]


def learn(
    recordings: Iterable[Recording | Path | str] | Recording | Path | str,
    into: PPSMemory | None = None,
    mode: Mode = "generic",
    seed: int = 0,
    robot: RobotSetup | None = None,
) -> PPSMemory:
    """Learn PPS maps from recordings of a robot in which its skin is touched.

    Where the touches clearly show that encoders or taxels are off, it learns again with them corrected; the correction
    is part of the memory.  So are the places at which a tool in the hand was touched: where two touches that a hand
    feels are more than 8 cm from it and near each other.

    Args:
        recordings: Recordings, or their folders, in the order to learn from them; or one.
        into: An earlier memory to continue from; None: an empty one.
        mode: How the object is tracked.
        seed: Seed of the particle filter.
        robot: Whose recordings they are; default: the iCub's.

    Returns:
        The memory: counts of touch and no touch by distance and time to contact, for every taxel of the skin and
        every place of a tool.

    Raises:
        InputError: A recording cannot be read or is not of a robot, or `into` has other taxels than the skin.
    """
    expect_kinds("learn", locals(), learn.__annotations__)
    robot = robot or icub_setup()
    before = PPSMemory.empty(robot.skin) if into is None else into
    given = (recordings,) if isinstance(recordings, Recording | Path | str) else recordings
    opened = [r if isinstance(r, Recording) else open_recording(r, robot=robot) for r in given]
    if not opened:
        raise InputError("learn", "no recording given; expected one or more")
    memory = before
    used = []
    for recording in opened:
        learned = learn_from(recording, memory, mode, seed, robot)
        memory = learned.memory
        used.append((recording, learned.touches))
    return learn_again(before, memory, used, mode, seed, robot)[0]


def learn_again(
    before: PPSMemory,
    memory: PPSMemory,
    used: Sequence[tuple[Recording, list[TouchTrial]]],
    mode: Mode,
    seed: int,
    robot: RobotSetup,
) -> tuple[PPSMemory, LearnedBody]:
    """The `memory` that `used` recordings have made of the one `before`, or where their touches clearly teach about the
    body the one that they make with it corrected; and what they teach.  Arguments and errors as in `learn`."""
    touches = [touch for _, touches in used for touch in touches]
    skin = Skin(before.skin_of(robot.skin).parts[: len(robot.skin.parts)])
    body = learned_body(robot.robot, robot.rig, skin, touches)
    corrected = with_tool(before, robot.skin, body.beyond)
    if body.is_corrected:
        offsets_rad = body.offsets_rad + (before.offsets_rad if len(before.offsets_rad) else 0.0)
        corrected = replace(corrected, offsets_rad=offsets_rad, positions_m=body.positions_m)
    if corrected is before:
        return memory, body
    for recording, _ in progress(used, desc="learn again", unit="recording"):
        corrected = learn_from(recording, corrected, mode, seed, robot).memory
    return corrected, body


def learn_from(recording: Recording, memory: PPSMemory, mode: Mode, seed: int, robot: RobotSetup) -> Learned:
    """Continue `memory` with one recording; arguments and errors as in `learn`."""
    skin = robot.skin
    if recording.robot is None:
        raise InputError(recording.name, "has no joints; expected the recording of a robot")
    tracker = tracker_for(recording, tracker_params(mode, objects=1), seed)
    pipeline = Pipeline(PipelineParams.of(robot), recording.robot, skin, tracker, memory, np.random.default_rng(seed))
    touches = []
    is_counted = False
    for frame in recording:
        touched = touched_at(recording.touches, frame.stamp_s, skin)
        step = pipeline.step(frame, touched)
        track = step.tracking.track
        if touched.any() and not is_counted and track.is_known:
            touches.append(TouchTrial.at_touch(track, step.posture.q_rad, touched))
        is_counted = bool(touched.any()) and (is_counted or track.is_known)
    after = pipeline.finish()
    return Learned(after, int(after.counts.sum() - memory.counts.sum()), pipeline.rejected, touches)


def touched_at(touches: tuple[Touch, ...], stamp_s: float, skin: Skin) -> Mask:
    """(n,) the taxels in the skin's latest report up to `stamp_s`, none if that is older than 60 ms.

    Taxels of other skins are ignored.
    """
    stamps = np.array([touch.stamp_s for touch in touches])
    latest = int(np.searchsorted(stamps, stamp_s + 1e-6)) - 1
    if latest < 0 or stamp_s - stamps[latest] > _MAX_TOUCH_AGE_S:
        return np.zeros(len(skin.taxel_ids), dtype=bool)
    return np.isin(skin.taxel_ids, touches[latest].taxel_ids)


def seen_hand(recordings: Iterable[Recording], robot: Robot, side: str, mode: Mode, seed: int = 0) -> SeenHand:
    """Return the postures of an arm with the positions at which both eyes saw its hand: the moving object, or marker.

    By the model of the `robot` the images become positions, here as where the map is used.  InputError if a recording
    is not of a robot, joints of the arm beyond the fourth move, or the hand is seen in fewer than 200 frames.
    """
    seen: list[tuple[Array, Observation3D]] = []
    n = 0
    for recording in recordings:
        n += len(recording)
        for _, frame, step in TrackedRecording(recording, tracker_params(mode, objects=1), seed).numbered():
            if frame.joints_left_rad is None or frame.joints_right_rad is None:
                raise InputError(recording.name, "has no joints; expected the recording of a robot")
            if step.observation is not None:
                seen.append((0.5 * (frame.joints_left_rad + frame.joints_right_rad), step.observation))
    if len(seen) < _FEWEST:
        raise InputError("reach train", f"the hand is seen in {len(seen)} of {n} frames; expected {_FEWEST} or more")
    q = np.array([joints for joints, _ in seen])
    names = robot.names.arm(side)
    others = [name for name in names[N_JOINTS:] if np.ptp(q[:, robot.indices((name,))]) > _REST_RAD]
    if len(names) < N_JOINTS or others:
        problem = f"the {side} arm moves {', '.join(names[:N_JOINTS] + tuple(others))}"
        raise InputError("reach train", f"{problem}; expected {N_JOINTS} joints, those beyond at rest")
    positions, covs = (np.array([getattr(o, name) for _, o in seen]) for name in ("p_root", "cov_root"))
    upright = GazeModel(robot).to_upright(q, positions)
    return SeenHand(q[:, robot.indices(names[:N_JOINTS])], upright, covs)
