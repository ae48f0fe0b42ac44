"""A real ball thrown at two real grey cameras whose calibration does not quite fit."""

import numpy as np
import pytest
from data import shared_data
from scipy.interpolate import CubicSpline

from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.types import StereoFrame
from tracking.tracker import Tracker, TrackerParams, TrackerStep

# Where the ball is, read off the pictures by eye: frame: (left u, v, right u, v)
SEEN = {
    8: (370, 91, 279.5, 86.5),
    14: (383, 71, 275.8, 65.8),
    20: (402, 55, 270.8, 51),
    26: (433, 51, 262.7, 48.6),
    30: (462, 65, 254, 60),
    34: (511, 98, 240, 93),
    38: (597, 180, 216, 175),
    39: (619, 207, 207, 207),
}


@pytest.fixture(scope="module", params=[0, 1])
def steps(request: pytest.FixtureRequest) -> dict[int, TrackerStep]:
    """What the tracker says on each frame, by the frame's number; nobody shows it the ball."""
    folder = shared_data("baseball")
    files = [folder / f"calibration_{name}_final.xml" for name in ("left", "right", "stereo")]
    left, right, T_left_right = read_stereo_calibration(files, (640, 480), 0.0254)
    tracker = Tracker(TrackerParams(), StereoRig.fixed(left, right, T_left_right), np.random.default_rng(request.param))
    recording = open_stereo_images([str(folder / "1L*.jpg")], [str(folder / "1R*.jpg")], fps=30.0)
    found = {}
    for number, frame in enumerate(recording, start=5):
        assert isinstance(frame, StereoFrame)
        found[number] = tracker.step(frame)
    return found


def test_the_ball_is_followed_in_both_views(steps: dict[int, TrackerStep]) -> None:
    path = CubicSpline(list(SEEN), np.array(list(SEEN.values())))
    hits = 0
    for number in range(8, 40):
        at = {d.camera: d.center_px for d in steps[number].detections}
        if len(at) == 2:
            u_left, v_left, u_right, v_right = path(number)
            off = [np.linalg.norm(at["left"] - (u_left, v_left)), np.linalg.norm(at["right"] - (u_right, v_right))]
            assert max(off) < 15, f"frame {number}: {off} px from the ball"
            hits += 1
    print(f"followed in both views on {hits} of 32 frames")
    assert hits >= 26


def test_the_path_is_smooth(steps: dict[int, TrackerStep]) -> None:
    known = [s.track for s in steps.values() if s.track.is_known]
    assert len(known) >= 24
    stamps, path = np.array([t.stamp_s for t in known]), np.array([t.position for t in known])
    flight = np.polynomial.Polynomial.fit
    for axis, allowed_m in ((0, 0.05), (1, 0.08), (2, 0.25)):  # depth is what a wrong calibration spoils
        smooth = flight(stamps, path[:, axis], 3)(stamps)
        assert np.sqrt(np.mean((path[:, axis] - smooth) ** 2)) < allowed_m
