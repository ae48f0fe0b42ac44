"""The numbers of a path against a truth that is known, on made-up tracks."""

import numpy as np
import pytest
from tracks import track_at

from pps_vision.app.track_statistics import CameraStatistics, PathStatistics
from pps_vision.types import Status, Track3D, Truth
from tracking.camera_pose import CameraMotion

FRAMES = 10
"""That come first and are not counted."""


def track(stamp_s: float, x_m: float, status: Status = Status.TRACKING) -> Track3D:
    return track_at((x_m, 0, 0), stamp_s=stamp_s, status=status)


def truth(stamp_s: float, x_m: float = 0.0, speed_m_s: float = 0.0) -> Truth:
    px = np.zeros(2)
    return Truth(stamp_s, np.array([x_m, 0.0, 0.0]), np.array([speed_m_s, 0.0, 0.0]), 0.03, px, px, True, True)


def later(*tracks: Track3D) -> list[Track3D]:
    """These after ten that are a metre off."""
    return [track(0.01 * k, 1.0) for k in range(FRAMES)] + list(tracks)


def numbers_of(tracks: list[Track3D], rows: tuple[Truth, ...] = ()) -> PathStatistics:
    numbers = PathStatistics(rows)
    for row in tracks:
        numbers.add(row)
    return numbers


def test_errors_are_those_of_what_is_tracked_and_of_what_is_predicted():
    rows = tuple(truth(0.01 * k, -1.0) for k in range(20))
    at_m = -1.0
    tracks = later(
        *(track(0.1, at_m + 0.003), track(0.11, at_m - 0.004), track(0.12, at_m + 0.012, Status.COASTING)),
        Track3D.unknown(0.13),
    )
    errors = numbers_of(tracks, rows).errors()
    assert errors["tracked_share"] == 0.5
    assert errors["position_rms_mm"] == pytest.approx(np.sqrt((9 + 16) / 2))
    assert errors["position_rms_all_mm"] == pytest.approx(np.sqrt((9 + 16 + 144) / 3))
    assert errors["position_median_mm"] == pytest.approx(3.5)
    assert errors["velocity_rms_m_s"] == 0


@pytest.mark.parametrize(("late_s", "counts"), [(0.018, True), (-0.022, False)])
def test_a_truth_of_another_moment_is_moved_on_for_a_fiftieth_of_a_second(late_s, counts):
    """An object at 2 m/s that is where it is said to be; of three rows of truth the nearest counts."""
    rows = truth(0.45, 7.0), truth(0.5 + late_s, 2.0 * late_s, 2.0), truth(0.9, 7.0)
    errors = numbers_of(later(track(0.5, 0.001)), rows).errors()
    assert errors["tracked_share"] == counts
    if counts:
        assert errors["position_rms_mm"] == pytest.approx(1.0)
        assert errors["velocity_rms_m_s"] == pytest.approx(2.0)
    else:
        assert np.isnan(errors["position_rms_mm"])


def test_cameras_are_said_to_have_moved_by_the_most_and_their_delay_is_the_last():
    warned: list[str] = []
    cameras = CameraStatistics(warned.append)
    for k, (turn, rate) in enumerate(((0.0, 0.0), (0.05, 0.02), (0.03, 0.04))):
        cameras.add(CameraMotion(np.array([0.0, 0.6, 0.8]) * turn, rate, 0.002 * k, 0.001 * k), 0.5 * k)
    assert cameras.summary() == pytest.approx(
        {"rotation_deg": 2.8648, "rotation_deg_s": 2.2918, "joint_delay_ms": 4.0, "joint_delay_std_ms": 2.0}, rel=1e-4
    )
    assert warned == ["the cameras move although declared fixed, at 0.50 s; only their rotation is compensated"]


def test_a_scene_without_fixed_points_is_warned_of_once():
    warned: list[str] = []
    cameras = CameraStatistics(warned.append)
    for k in range(8):
        cameras.add(CameraMotion(np.zeros(3), 0.0, 0.0, 0.0, is_seen=k == 0), 0.4 * k)
    assert np.isnan(cameras.summary()["rotation_deg"])
    (line,) = warned
    assert line.startswith("nothing in the images shows whether the cameras rest")
