"""A real ball thrown at two real grey cameras whose calibration does not quite fit."""

import numpy as np
import pytest
from baseball_truth import FIRST, ball_px, baseball
from data import shared_data

from tracking.tracker import Tracker, TrackerParams, TrackerStep


@pytest.fixture(scope="module", params=[0, 1])
def steps(request: pytest.FixtureRequest) -> dict[int, TrackerStep]:
    """Tracker steps by frame number; the tracker has to find the ball by itself."""
    recording = baseball(shared_data("baseball"))
    tracker = Tracker(TrackerParams(), recording.rig, np.random.default_rng(request.param))
    return {number: tracker.step(frame) for number, frame in enumerate(recording.frames, start=FIRST)}


def test_the_ball_is_followed_in_both_views(steps):
    hits = 0
    for number in range(8, 40):
        at = {d.camera: d.center_px for d in steps[number].detections}
        if len(at) == 2:
            u_left, v_left, u_right, v_right = ball_px(number)
            off = [np.linalg.norm(at["left"] - (u_left, v_left)), np.linalg.norm(at["right"] - (u_right, v_right))]
            assert max(off) < 15, f"frame {number}: {off} px from the ball"
            hits += 1
    print(f"followed in both views on {hits} of 32 frames")
    assert hits >= 26


def test_the_path_is_smooth(steps):
    tracks = [s.track for s in steps.values() if s.track.is_known]
    assert len(tracks) >= 24
    stamps = np.array([t.stamp_s for t in tracks])
    path = np.array([t.position for t in tracks])
    flight = np.polynomial.Polynomial.fit
    for axis, allowed_m in ((0, 0.05), (1, 0.08), (2, 0.25)):  # a wrong calibration mostly affects the depth
        smooth = flight(stamps, path[:, axis], 3)(stamps)
        assert np.sqrt(np.mean((path[:, axis] - smooth) ** 2)) < allowed_m
