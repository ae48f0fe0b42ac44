"""Touches of a recording, from which offsets of the encoders are learned."""

import numpy as np

from learning.pps.touch_trial import TouchTrial
from pps_vision.app.learn import touched_at
from pps_vision.app.pipeline import joints_of
from pps_vision.app.track import tracker_for
from pps_vision.recordings.recording import Recording
from pps_vision.robot.skin import Skin
from pps_vision.types import Mask, StereoFrame, Track3D
from tracking.names import Mode
from tracking.tracker import TrackerParams


def touches_seen(recording: Recording, skin: Skin, mode: Mode, seed: int) -> list[TouchTrial]:
    """Of each contact in a recording the first moment at which what touches is tracked."""
    tracker = tracker_for(recording, TrackerParams(mode=mode), seed)
    touches, told = [], False
    for frame in recording:
        track, touched = tracker.step(frame).track, touched_at(recording.touches, frame.stamp_s, skin)
        if touched.any() and not told and track.is_known:
            touches.append(_touch(frame, track, touched))
        told = bool(touched.any()) and (told or track.is_known)
    return touches


def _touch(frame: StereoFrame, track: Track3D, touched: Mask) -> TouchTrial:
    """One moment of a contact."""
    return TouchTrial(
        np.array([frame.stamp_s]),
        joints_of(frame)[None],
        track.position[None],
        track.velocity[None],
        track.cov[None, 3:6, 3:6],
        np.array([track.radius_m]),
        touched,
        "",
    )
