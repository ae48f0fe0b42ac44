"""Grey images leave only motion to tell an object by, and a moving eye makes everything move."""

import cv2
import numpy as np
import pytest
from data import SEED

from pps_vision.app.render import Render
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import tracker_for
from pps_vision.recordings.yarp import open_yarp
from pps_vision.types import Image, StereoFrame
from tracking.tracker import TrackerParams


def grey(image: Image) -> Image:
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)


@pytest.mark.parametrize("head", ["sway", "follow"])
def test_what_is_not_sure_is_not_tracked(tmp_path, head) -> None:
    Render("ball", "circle", tmp_path / "rec", seconds=3.0, noise=2.0, head=head, seed=SEED).record()
    recording = open_yarp(tmp_path / "rec")
    tracker = tracker_for(recording, TrackerParams(), SEED, Stopwatch())
    wrong = 0
    for frame, truth in zip(recording, recording.truth, strict=True):
        seen = StereoFrame(
            grey(frame.left),
            grey(frame.right),
            frame.stamp_left_s,
            frame.stamp_right_s,
            frame.joints_left_rad,
            frame.joints_right_rad,
        )
        track = tracker.step(seen).track
        wrong += track.is_known and np.linalg.norm(track.position - truth.position) > 0.05
    assert wrong == 0
