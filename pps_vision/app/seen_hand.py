"""Motor babbling as the eyes see it: recordings in which an arm moves and its hand is tracked."""

from collections.abc import Iterable

import numpy as np

from learning.reach.babbling import SeenHand
from learning.reach.forward_model import N_JOINTS
from pps_vision.app.track import TrackedRecording, tracker_params
from pps_vision.errors import InputError
from pps_vision.recordings.recording import Recording
from pps_vision.robot.gaze import GazeModel
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Observation3D
from tracking import Mode

_LEAST = 200  # postures, for the 81 coefficients of a coordinate
_REST_RAD = np.deg2rad(1.0)  # largest motion of a joint at rest


def seen_hand(recordings: Iterable[Recording], robot: Robot, side: str, mode: Mode, seed: int = 0) -> SeenHand:
    """Return the postures of an arm with the positions at which both eyes saw its hand.

    Args:
        recordings: Recordings of the robot; the moving object in them, or the marker, is the hand.
        robot: Its model, by which the eyes' images become positions, here as where the map is used.
        side: The arm, whose wrist is at rest.
        mode: How the hand is tracked.
        seed: Seed of the particle filter.

    Raises:
        InputError: A recording is not of a robot, joints of the arm beyond the fourth move, or the hand is seen in
            fewer than 200 frames.
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
    if len(seen) < _LEAST:
        raise InputError("reach train", f"the hand is seen in {len(seen)} of {n} frames; expected {_LEAST} or more")
    q = np.array([joints for joints, _ in seen])
    names = robot.names.arm(side)
    others = [name for name in names[N_JOINTS:] if np.ptp(q[:, robot.indices((name,))]) > _REST_RAD]
    if len(names) < N_JOINTS or others:
        problem = f"the {side} arm moves {', '.join(names[:N_JOINTS] + tuple(others))}"
        raise InputError("reach train", f"{problem}; expected {N_JOINTS} joints, those beyond at rest")
    positions, covs = (np.array([getattr(o, name) for _, o in seen]) for name in ("p_root", "cov_root"))
    upright = GazeModel(robot).to_upright(q, positions)
    return SeenHand(q[:, robot.indices(names[:N_JOINTS])], upright, covs)
