"""Learn from recordings in which the skin is touched: PPS maps (`pps_vision.learn`), and touches for calibration."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineParams, joints_of
from pps_vision.app.track import tracker_for, tracker_params
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording, Touch
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import Skin
from pps_vision.types import Mask
from tracking import Mode

_MAX_TOUCH_AGE_S = 0.06  # the skin reports every 0.02 to 0.05 s


@dataclass(frozen=True)
class Learned:
    """The memory after a recording, number of new samples, number of rejected samples by reason."""

    memory: PPSMemory
    samples: int
    rejected: dict[str, int]


def learn(
    recordings: Iterable[Recording | Path | str],
    into: PPSMemory | None = None,
    mode: Mode = "generic",
    seed: int = 0,
    robot: RobotSetup | None = None,
) -> PPSMemory:
    """Learn PPS maps from recordings of a robot in which its skin is touched.

    Args:
        recordings: Recordings, or their folders, in the order to learn from them.
        into: An earlier memory to continue from; None: an empty one.
        mode: How the object is tracked.
        seed: Seed of the particle filter.
        robot: Whose recordings they are; default: the iCub's.

    Returns:
        The memory: counts of touch and no touch by distance and time to contact, for every taxel of the skin.

    Raises:
        InputError: A recording cannot be read or is not of a robot, or `into` has other taxels than the skin.
    """
    robot = robot or icub_setup()
    memory = PPSMemory.empty(robot.skin) if into is None else into
    for recording in recordings:
        opened = recording if isinstance(recording, Recording) else open_recording(recording, robot=robot)
        memory = learn_from(opened, memory, mode, seed, robot).memory
    return memory


def learn_from(recording: Recording, memory: PPSMemory, mode: Mode, seed: int, robot: RobotSetup) -> Learned:
    """Continue `memory` with one recording; arguments and errors as in `learn`."""
    skin = robot.skin
    if recording.robot is None:
        raise InputError(recording.name, "has no joints; expected the recording of a robot")
    tracker = tracker_for(recording, tracker_params(mode, objects=1), seed)
    pipeline = Pipeline(PipelineParams.of(robot), recording.robot, skin, tracker, memory, np.random.default_rng(seed))
    for frame in recording:
        pipeline.step(frame, touched_at(recording.touches, frame.stamp_s, skin))
    after = pipeline.finish()
    return Learned(after, int(after.counts.sum() - memory.counts.sum()), pipeline.rejected)


def tracked_touches(recording: Recording, skin: Skin, mode: Mode, seed: int) -> list[TouchTrial]:
    """The first frame of each contact in which the object is tracked."""
    tracker = tracker_for(recording, tracker_params(mode, objects=1), seed)
    trials = []
    is_counted = False
    for frame in recording:
        track = tracker.step(frame).track
        touched = touched_at(recording.touches, frame.stamp_s, skin)
        if touched.any() and not is_counted and track.is_known:
            state = track.position[None], track.velocity[None], track.cov[None, 3:6, 3:6], np.array([track.radius_m])
            trials.append(TouchTrial(np.array([frame.stamp_s]), joints_of(frame)[None], *state, touched))
        is_counted = bool(touched.any()) and (is_counted or track.is_known)
    return trials


def touched_at(touches: tuple[Touch, ...], stamp_s: float, skin: Skin) -> Mask:
    """(n,) the taxels in the skin's latest report up to `stamp_s`, none if that is older than 60 ms.

    Taxels of other skins are ignored.
    """
    stamps = np.array([touch.stamp_s for touch in touches])
    latest = int(np.searchsorted(stamps, stamp_s + 1e-6)) - 1
    if latest < 0 or stamp_s - stamps[latest] > _MAX_TOUCH_AGE_S:
        return np.zeros(len(skin.taxel_ids), dtype=bool)
    return np.isin(skin.taxel_ids, touches[latest].taxel_ids)
