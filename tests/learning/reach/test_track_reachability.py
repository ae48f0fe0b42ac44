"""The reachability of the tracked object, against a map whose border is a plane of the gaze."""

import numpy as np
import pytest

from learning.reach.labels import Labels
from learning.reach.map import ReachableMap, TrackReachability
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, load_icub
from pps_vision.types import ReachStatus, Status, Track3D

ROBOT = load_icub()
LIMITS = GazeLimits()
NONE = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))


def left_half(limits: GazeLimits = LIMITS, softness: float = 0.01) -> ReachableMap:
    """A map by which what lies at negative yaw is within reach."""
    yaw = np.linspace(*limits.yaw_rad, 41)
    signed = -yaw[:, None, None] * np.ones((41, 5, 5))
    return ReachableMap("left", limits, signed, 0.6 + 0 * signed, 0.2 + 0 * signed, 0.4, softness, 0.0, NONE, 0)


def track(point: np.ndarray, status: Status = Status.TRACKING) -> Track3D:
    mean = np.zeros((4, 3))
    mean[0] = point
    return Track3D(3.5, mean, np.eye(12), 0.03, 1e-4, status)


def at_gaze(*gaze_rad: float) -> np.ndarray:
    return fixation_points(ROBOT, [gaze_rad])[0]


@pytest.mark.parametrize("status", [Status.TRACKING, Status.COASTING])
@pytest.mark.parametrize("yaw", [-0.4, -0.05, 0.05, 0.4])
def test_the_map_is_asked_for_the_gaze_that_fixates_the_track(yaw, status):
    reach = TrackReachability(ROBOT, left_half())(home(ROBOT), track(at_gaze(yaw, -0.3, 0.3), status))
    np.testing.assert_allclose(reach.gaze_rad, [yaw, -0.3, 0.3], atol=1e-9)
    assert reach.stamp_s == 3.5
    assert reach.status == (ReachStatus.REACHABLE if yaw < 0 else ReachStatus.UNREACHABLE)
    assert reach.is_reachable == (yaw < 0)
    assert reach.degree == pytest.approx(0.8 if yaw < 0 else 0.25, abs=1e-6)
    assert reach.probability == pytest.approx(1 / (1 + np.exp(yaw / 0.01)), abs=1e-6)


def test_head_and_arms_do_not_matter_and_a_turned_torso_carries_all():
    judge = TrackReachability(ROBOT, left_half())
    rng = np.random.default_rng(0)
    point = at_gaze(-0.2, -0.3, 0.3)
    chest = ROBOT.at(np.zeros(ROBOT.n_joints)).T_root("chest")
    for _ in range(5):
        q = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
        turned = ROBOT.at(q).T_root("chest") @ np.linalg.inv(chest) @ [*point, 1]
        np.testing.assert_allclose(judge(q, track(turned[:3])).gaze_rad, [-0.2, -0.3, 0.3], atol=1e-9)


@pytest.mark.parametrize(
    ("seen", "status"),
    [
        *((Track3D.unknown(1.0, status), ReachStatus.UNKNOWN) for status in (Status.SEARCHING, Status.LOST)),
        (track(at_gaze(-0.98, 0, 0.3)), ReachStatus.NOT_FIXATED),  # aside
        (track(at_gaze(-0.2, -0.75, 0.3)), ReachStatus.NOT_FIXATED),  # below
        (track(at_gaze(-0.2, -0.3, 0.08)), ReachStatus.NOT_FIXATED),  # far
        (track(np.array([0.4, -0.1, 0.3])), ReachStatus.NOT_FIXATED),  # behind
        (track(np.array([-0.04, 0, 0.9])), ReachStatus.NOT_FIXATED),  # above
    ],
)
def test_of_what_is_unknown_or_beyond_the_maps_limits_nothing_is_claimed(seen, status):
    reach = TrackReachability(ROBOT, left_half())(home(ROBOT), seen)
    assert reach.status == status
    assert not reach.is_reachable
    assert np.isnan([*reach.gaze_rad, reach.probability, reach.degree]).all()


def test_the_limits_are_the_maps_own():
    wide = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    below = track(at_gaze(-0.2, -1.2, 0.3))
    assert TrackReachability(ROBOT, left_half(wide))(home(ROBOT), below).is_reachable


def test_few_false_positives_are_asked_for_by_a_higher_probability():
    """Softness 0.1: at yaw −0.1 the map gives 0.73, and calls that reachable only if many errors are allowed."""
    soft = left_half(softness=0.1)
    beside = track(at_gaze(-0.1, -0.3, 0.3))
    few, many = (TrackReachability(ROBOT, soft, most)(home(ROBOT), beside) for most in (1e-3, 0.3))
    assert few.probability == many.probability == pytest.approx(0.731, abs=0.001)
    assert (few.status, many.status) == (ReachStatus.UNREACHABLE, ReachStatus.REACHABLE)


def test_a_border_that_lies_between_points_of_the_lattice_leaves_what_is_sure_reachable():
    """All of the lattice's probabilities but one are 0 or 1."""
    judge = TrackReachability(ROBOT, left_half(softness=1e-6))
    said = [judge(home(ROBOT), track(at_gaze(yaw, -0.3, 0.3))).is_reachable for yaw in (-0.4, -0.001, 0.001, 0.4)]
    assert said == [True, True, False, False]
