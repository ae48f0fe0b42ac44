"""The lattice and its splines against their definitions, maps whose values are known everywhere, and their verdicts on
the tracked object."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.reach.labels import Labels
from learning.reach.lattice import GazeSpline, Lattice, isotropic
from learning.reach.map import ReachableMap, TrackReachability, both
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, load_icub
from pps_vision.types import ReachStatus, Status, Track3D

LIMITS = GazeLimits()
NO_LABELS = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))


def random_gaze(n, seed=SEED):
    return np.random.default_rng(seed).uniform(LIMITS.lower, LIMITS.upper, (n, 3))


def reachable_map(signed, shape=(9, 10, 60), limits=LIMITS, **changes):
    """A map whose signed distance is a function of isotropic coordinates, linear in each."""
    values = signed(isotropic(Lattice(limits, shape).gaze_rad)).reshape(shape)
    good = np.full(shape, 0.6)
    off = np.full(shape, 0.05)
    return replace(ReachableMap("left", limits, values, good, off, 0.1, 0.02, 0.01, NO_LABELS, 0), **changes)


@pytest.mark.parametrize("spacing", [0.04, 0.1, 0.37])
def test_a_lattice_is_the_coarsest_with_steps_no_longer_than_asked(spacing):
    extent = isotropic(LIMITS.upper) - isotropic(LIMITS.lower)
    steps = np.array(Lattice.of_spacing(LIMITS, spacing).shape) - 1
    assert np.all(extent / steps <= spacing + 1e-12)
    assert np.all(extent / (steps - 1) > spacing)


def test_a_degree_is_between_0_and_1_and_reachable_is_what_is_more_likely_than_not():
    learned = reachable_map(lambda at: 0.1 * at[:, 0])
    beyond = replace(learned, optimality=1.4 + 0 * learned.optimality, error_m=0.3 + 0 * learned.error_m)
    gaze = random_gaze(500)
    np.testing.assert_array_equal(beyond.query(gaze).degree, np.where(gaze[:, 0] > 0, 1.0, 0.0))
    np.testing.assert_array_equal(learned.query(gaze).reachable, gaze[:, 0] > 0)
    with pytest.raises(ValueError, match=r"expected \(N, 3\)"):
        learned.query([0, 0, 0.3])


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_the_threshold_allows_the_false_positives_asked_for(share):
    """By the map's own probabilities at gaze postures drawn evenly in angles, not in lattice coordinates."""
    learned = reachable_map(lambda at: 0.03 * (at[:, 2] + 1.2 + at[:, 0]), (30, 3, 80))
    threshold = learned.threshold(share)
    p = learned.query(random_gaze(200_000)).probability
    allowed = (1 - p)[p > threshold].sum() / (1 - p).sum()
    assert threshold >= 0.5
    assert allowed == pytest.approx(share, rel=0.15) if threshold > 0.5 else allowed <= share


def test_thresholds_have_bounds():
    learned = reachable_map(lambda at: 0.03 * at[:, 0])
    assert learned.threshold(0.999) == 0.5
    for share in (0.0, 1.0):
        with pytest.raises(InputError, match="above 0 and below 1"):
            learned.threshold(share)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"max_error_m": 0.0}, "above 0"),
        ({name: np.zeros((1, 4, 5)) for name in ("signed_distance", "optimality", "error_m")}, "at least 2"),
    ],
)
def test_maps_that_could_not_be_asked_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        reachable_map(lambda at: at[:, 0], **changes)


def test_every_number_is_saved(tmp_path):
    learned = reachable_map(
        lambda at: at[:, 1], expected_error=0.03, unanswered=7, end_point="left_forearm:27", measure="isotropy"
    )
    labels = Labels(random_gaze(3), np.array([True, False, True]), np.arange(3.0), np.arange(3.0) + 3, random_gaze(3))
    replace(learned, labels=labels).save(tmp_path / "map.npz")
    again = ReachableMap.load(tmp_path / "map.npz")
    for name in ("side", "limits", "max_error_m", "softness", "expected_error", "unanswered", "end_point", "measure"):
        assert getattr(again, name) == getattr(learned, name), name
    for name in ("signed_distance", "optimality", "error_m"):
        np.testing.assert_array_equal(getattr(again, name), getattr(learned, name))
    for name in ("gaze_rad", "reachable", "error_m", "optimality", "border_rad"):
        np.testing.assert_array_equal(getattr(again.labels, name), getattr(labels, name))
    pair = both(again, replace(again, side="right"))
    assert (pair.end_point, pair.measure) == ("left_forearm:27", "isotropy")


ROBOT = load_icub()


def left_half(limits: GazeLimits = LIMITS, softness: float = 0.01) -> ReachableMap:
    """A map by which what lies at negative yaw is within reach."""
    learned = reachable_map(lambda at: -at[:, 0], (41, 5, 5), limits)
    return replace(learned, error_m=4 * learned.error_m, max_error_m=0.4, softness=softness)


def track(point: np.ndarray, status: Status = Status.TRACKING) -> Track3D:
    mean = np.zeros((4, 3))
    mean[0] = point
    return Track3D(3.5, mean, np.eye(12), 0.03, 1e-4, status)


def at_gaze(*gaze_rad: float) -> np.ndarray:
    return fixation_points(ROBOT, [gaze_rad])[0]


@pytest.mark.parametrize("status", [Status.TRACKING, Status.COASTING])
@pytest.mark.parametrize("yaw", [-0.4, -0.05, 0.05, 0.4])
def test_the_map_is_asked_for_the_gaze_that_fixates_the_track(yaw, status):
    reach = TrackReachability(ROBOT, left_half(), 1e-3)(home(ROBOT), track(at_gaze(yaw, -0.3, 0.3), status))
    np.testing.assert_allclose(reach.gaze_rad, [yaw, -0.3, 0.3], atol=1e-9)
    assert reach.stamp_s == 3.5
    assert reach.status == (ReachStatus.REACHABLE if yaw < 0 else ReachStatus.UNREACHABLE)
    assert reach.is_reachable == (yaw < 0)
    assert reach.degree == pytest.approx(0.8 if yaw < 0 else 0.25, abs=1e-6)
    assert reach.probability == pytest.approx(1 / (1 + np.exp(yaw / 0.01)), abs=1e-6)


def test_head_and_arms_do_not_matter_and_a_turned_torso_carries_all():
    judge = TrackReachability(ROBOT, left_half(), 1e-3)
    rng = np.random.default_rng(0)
    point = at_gaze(-0.2, -0.3, 0.3)
    chest = ROBOT.at(np.zeros(ROBOT.n_joints)).T_root("chest")
    for _ in range(5):
        q = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
        turned = ROBOT.at(q).T_root("chest") @ np.linalg.inv(chest) @ [*point, 1]
        np.testing.assert_allclose(judge(q, track(turned[:3])).gaze_rad, [-0.2, -0.3, 0.3], atol=1e-9)


@pytest.mark.parametrize(
    ("current", "status"),
    [
        *((Track3D.unknown(1.0, status), ReachStatus.UNKNOWN) for status in (Status.SEARCHING, Status.LOST)),
        (track(at_gaze(-0.98, 0, 0.3)), ReachStatus.NOT_FIXATED),  # aside
        (track(at_gaze(-0.2, -0.75, 0.3)), ReachStatus.NOT_FIXATED),  # below
        (track(at_gaze(-0.2, -0.3, 0.08)), ReachStatus.NOT_FIXATED),  # far
        (track(np.array([0.4, -0.1, 0.3])), ReachStatus.NOT_FIXATED),  # behind
        (track(np.array([-0.04, 0, 0.9])), ReachStatus.NOT_FIXATED),  # above
    ],
)
def test_of_what_is_unknown_or_beyond_the_maps_limits_nothing_is_claimed(current, status):
    reach = TrackReachability(ROBOT, left_half(), 1e-3)(home(ROBOT), current)
    assert reach.status == status
    assert not reach.is_reachable
    assert np.isnan([*reach.gaze_rad, reach.probability, reach.degree]).all()


def test_the_limits_are_the_maps_own():
    wide = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    below = track(at_gaze(-0.2, -1.2, 0.3))
    assert TrackReachability(ROBOT, left_half(wide), 1e-3)(home(ROBOT), below).is_reachable


def test_few_false_positives_are_asked_for_by_a_higher_probability():
    """Softness 0.1: at yaw −0.1 the map gives 0.73, and calls that reachable only if many errors are allowed."""
    soft = left_half(softness=0.1)
    beside = track(at_gaze(-0.1, -0.3, 0.3))
    few, many = (TrackReachability(ROBOT, soft, most)(home(ROBOT), beside) for most in (1e-3, 0.3))
    assert few.probability == many.probability == pytest.approx(0.731, abs=0.001)
    assert (few.status, many.status) == (ReachStatus.UNREACHABLE, ReachStatus.REACHABLE)


def test_an_object_is_reachable_by_touch_where_the_end_point_comes_near_enough_to_its_surface():
    """At a degree of 0.25 half of the largest 40 cm are left to the centre, of a ball of 3 cm 17 cm to its surface."""
    ball = track(at_gaze(0.25, -0.3, 0.3))
    said = [TrackReachability(ROBOT, left_half(), 1e-3, touch_m)(home(ROBOT), ball) for touch_m in (0.16, 0.18)]
    assert [reach.is_reachable for reach in said] == [False, True]


def test_a_border_that_lies_between_points_of_the_lattice_leaves_what_is_sure_reachable():
    """All of the lattice's probabilities but one are 0 or 1."""
    judge = TrackReachability(ROBOT, left_half(softness=1e-6), 1e-3)
    said = [judge(home(ROBOT), track(at_gaze(yaw, -0.3, 0.3))).is_reachable for yaw in (-0.4, -0.001, 0.001, 0.4)]
    assert said == [True, True, False, False]


def test_nodes_are_met_and_between_them_it_follows_a_smooth_function():
    nodes = random_gaze(3000)
    queries = random_gaze(200, 1) * 0.8 + 0.1 * (LIMITS.lower + LIMITS.upper)
    spline = GazeSpline(nodes, np.sin(3 * nodes).sum(axis=1))
    np.testing.assert_allclose(spline(nodes[:50]), np.sin(3 * nodes[:50]).sum(axis=1), atol=1e-9)
    assert np.sqrt(np.mean((spline(queries) - np.sin(3 * queries).sum(axis=1)) ** 2)) < 3e-3
    assert spline(np.zeros((0, 3))).shape == (0,)
