"""The reachable-space map, also of other end points and measures, against the arm in closed form and plain geometry."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.reach.labels import Labels, ReachOracle, hand_and_params
from learning.reach.map import ReachableMap, both
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import DirectionCoverage, FarFromLimits
from pps_vision.robot.skin import EndPoint

ROBOT = load_icub()
LIMITS = GazeLimits()
LOWER = np.array(ArmLimits().lower_rad)
UPPER = np.array(ArmLimits().upper_rad)
ARM = ROBOT.chain(ROBOT.names.arm("right")[:4], "right_palm")


@pytest.fixture(scope="module")
def learned():
    return train_reachable_map(ROBOT, "right", np.random.default_rng(0))


@pytest.fixture(scope="module")
def fresh():
    """Answers in closed form to questions the map never asked; how far the hand stays off, by inverse kinematics."""
    rng = np.random.default_rng(99)
    labels = ReachOracle(ROBOT, "right", MapParams(), rng).label(rng.uniform(LIMITS.lower, LIMITS.upper, (3000, 3)))
    assert labels.answered.mean() > 0.99
    reachable, optimality = truth(labels.gaze_rad)
    return replace(labels, reachable=reachable, optimality=optimality)


def truth(gaze):
    """Whether a posture reaches the fixation point, and 1 − M of the best."""
    _, effort = SphericalArm.of(ARM, LOWER, UPPER).least_effort(fixation_points(ROBOT, gaze))
    return np.isfinite(effort), 1 - effort


def rates(judged, truth):
    """Judgement errors of all, false negatives of the reachable, false positives of the others."""
    return (judged != truth).mean(), (~judged & truth).sum() / truth.sum(), (judged & ~truth).sum() / (~truth).sum()


def test_judges_random_gaze_postures(learned, fresh):
    je, fn, fp = rates(learned.query(fresh.gaze_rad).reachable, fresh.reachable)
    assert fresh.reachable.mean() == pytest.approx(0.19, abs=0.02)  # by an independent sampling of the same tables
    assert je <= 0.003
    assert fn <= 0.005
    assert fp <= 0.003


def test_judges_the_box_of_locations_that_j_tested(learned):
    sim = np.random.default_rng(7).uniform([-0.10, 0.75, 0.20], [0.10, 0.95, 0.35], (1500, 3))
    points = np.stack([-sim[:, 2] - 0.026, -sim[:, 0], sim[:, 1] - 0.5976], axis=1)
    gaze = gaze_for_points(ROBOT, points)
    gaze = gaze[np.isfinite(gaze[:, 0])]
    je, *_ = rates(learned.query(gaze).reachable, truth(gaze)[0])
    assert je <= 0.01  # J's Basic map: 0.013


def test_the_farthest_and_the_closest_reachable_point():
    """J Fig 3: least vergence with the arm outstretched, with our tables' values; vergence 89.15° fully bent."""
    q = np.random.default_rng(6).uniform(LOWER, UPPER, (60_000, 4))
    gaze = gaze_for_points(ROBOT, ARM.positions(q[:12_000])[0])
    assert np.isfinite(gaze[:, 0]).mean() == pytest.approx(0.28, abs=0.02)  # by an independent sampling of the tables
    farthest = np.nanargmin(gaze[:, 2])
    assert np.rad2deg(gaze[farthest, 2]) == pytest.approx(10.4, abs=0.5)
    assert np.rad2deg(q[farthest, 3]) == pytest.approx(15, abs=5)
    q[:, 3] = np.deg2rad(105)
    palms = ARM.positions(q)[0]
    left, right = ROBOT.eye_poses(np.zeros(ROBOT.n_joints))
    near = np.argsort(np.linalg.norm(palms - (left + right)[:3, 3] / 2, axis=1))[:10_000]
    assert np.rad2deg(np.nanmax(gaze_for_points(ROBOT, palms[near])[:, 2])) == pytest.approx(89.15, abs=1)


def test_probability_means_what_it_says(learned, fresh):
    p = learned.query(fresh.gaze_rad).probability
    assert np.mean((p - fresh.reachable) ** 2) < 0.006
    assert fresh.reachable[p < 0.1].mean() < 0.01
    assert fresh.reachable[p > 0.9].mean() > 0.98


def test_degree(learned, fresh):
    """R of J IV.6 (the printed one leaves [0, 1]) and IV.7 from the fresh answers."""
    reached = (1 + fresh.optimality) / 2
    expected = np.where(fresh.reachable, reached, (1 - fresh.error_m / learned.max_error_m) / 2)
    degree = learned.query(fresh.gaze_rad).degree
    rmse = np.sqrt(np.nanmean((degree - expected) ** 2))
    assert rmse <= 0.011  # J's Enhanced map: 0.022
    assert degree.min() >= 0
    assert degree.max() <= 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 7}, "version 7; expected version 6"),
        ({"signed_distance": None}, "no signed_distance; expected"),
        ({"optimality": np.zeros((4, 5, 6))}, r"optimality \(4, 5, 6\)"),
        ({"label_error_m": np.zeros(3)}, r"labels of shapes .*'error_m': \(3,\)"),
        ({"softness": 0.0}, "softness 0.0"),
        ({"limits_rad": np.zeros((3, 2))}, "lower below upper"),
    ],
)
def test_a_bad_file_is_refused_by_name(learned, tmp_path, changes, message):
    path = tmp_path / "map.npz"
    learned.save(path)
    with np.load(path) as file:
        arrays = {name: array for name, array in {**file, **changes}.items() if array is not None}
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=rf"map\.npz: .*{message}"):
        ReachableMap.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_labels": 100, "round_labels": 60}, "expected at least two rounds"),  # one could not say how sure it is
        ({"round_labels": 0}, "expected at least two rounds"),
        *(({"max_error": share}, "at least 0 and below 1") for share in (1.0, -0.01)),
        ({"n_test": -1}, "test postures"),
        *(({"confidence": share}, "confidence") for share in (1.0, 0.0)),
        ({"n_babble": 15}, "expected at least 16"),
    ],
)
def test_params_that_make_no_sense(changes, message):
    with pytest.raises(ValueError, match=message):
        MapParams(**changes)


@pytest.mark.long
def test_it_stops_when_sure_enough_and_goes_on_when_asked():
    """Half the error asked for takes more labels; going on from a map is as good as having learned it at once."""
    rough = MapParams(n_labels=3000, round_labels=300, n_babble=10_000, max_error=0.04, lattice=0.1)
    first = train_reachable_map(ROBOT, "right", np.random.default_rng(11), rough)
    assert 600 <= len(first.labels.gaze_rad) + first.unanswered < 2500
    assert first.error_bound <= 0.04
    more = train_reachable_map(ROBOT, "right", np.random.default_rng(12), replace(rough, max_error=0.02), into=first)
    assert len(more.labels.gaze_rad) > len(first.labels.gaze_rad)
    gaze = np.random.default_rng(13).uniform(LIMITS.lower, LIMITS.upper, (4000, 3))
    wrong = [rates(maps.query(gaze).reachable, truth(gaze)[0])[0] for maps in (first, more)]
    assert wrong[0] <= first.error_bound
    assert wrong[1] <= more.error_bound
    assert wrong[0] <= 0.04
    assert wrong[1] < wrong[0]
    with pytest.raises(ValueError, match="to continue from"):
        train_reachable_map(ROBOT, "left", np.random.default_rng(12), rough, into=first)


def test_both_hands_have_the_worse_of_every_number():
    none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    rng = np.random.default_rng(SEED)
    parts = [tuple(rng.uniform(0, 1, (2, 3, 4)) for _ in range(3)) for _ in range(2)]
    left = ReachableMap("left", LIMITS, *parts[0], 1.0, 0.03, 0.01, none, 5)
    right = ReachableMap("right", LIMITS, *parts[1], 2.0, 0.02, 0.04, none, 7)
    for pair in (both(left, right), both(right, left)):
        np.testing.assert_array_equal(pair.signed_distance, np.minimum(parts[0][0], parts[1][0]))
        np.testing.assert_array_equal(pair.optimality, np.minimum(parts[0][1], parts[1][1]))
        np.testing.assert_array_equal(pair.error_m, np.maximum(parts[0][2], parts[1][2]))
        assert (pair.max_error_m, pair.softness, pair.unanswered) == (2.0, 0.03, 12)
        assert pair.expected_error == pytest.approx(0.05)
        assert pair.error_bound == 1.0
    bounded = both(replace(left, error_bound=0.01), replace(right, error_bound=0.02))
    assert bounded.error_bound == pytest.approx(0.03)
    with pytest.raises(ValueError, match="same limits and lattice"):
        both(left, replace(right, limits=GazeLimits(vergence_rad=(0.1, 1.0))))


def test_verdicts_are_those_of_the_closed_form():
    """Within 0.05 % of random gaze postures: the labels' tolerance of 0.1 mm alone would cost as much."""
    gaze = np.random.default_rng(SEED).uniform(LIMITS.lower, LIMITS.upper, (2000, 3))
    said = ReachOracle(ROBOT, "right", MapParams(), np.random.default_rng(SEED)).verdicts(gaze)
    true = truth(gaze)[0]
    assert np.mean(said != true) <= 5e-4


WIDE = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))  # arms are seen from above
PARAMS = MapParams(WIDE, n_labels=800, round_labels=200, n_babble=20_000)


def best_measure(side, end_point, params, gaze):
    """(N,) measure of the best of 121 postures on each curve that reaches a fixation point; NaN out of reach."""
    limits = params.arm_limits
    lower = np.array(limits.lower_rad)
    upper = np.array(limits.upper_rad)
    point = EndPoint.of(ROBOT, side, end_point, 4)
    tip = point.chain.T_root_frame.copy()
    tip[:3, 3] += tip[:3, :3] @ point.point
    arm = SphericalArm.of(replace(point.chain, T_root_frame=tip), lower, upper)
    places = fixation_points(ROBOT, gaze)
    curves = np.concatenate([arm.curves(places, 121), arm.solve(places)[:, None]], axis=1)
    best = np.full(len(gaze), np.nan)
    for k, curve in enumerate(curves):
        q = curve[np.isfinite(curve[:, 0])]
        if len(q) and isinstance(params.measure, DirectionCoverage):
            near = np.cos(params.measure.within_rad)
            best[k] = (point.normals(q) @ params.measure.directions.T >= near).any(axis=0).mean()
        elif len(q):
            measure = params.measure or FarFromLimits(lower, upper)
            best[k] = measure(q, point.positions(q)[1]).max()
    return best


@pytest.mark.parametrize(
    ("side", "end_point", "measure", "tolerance"),
    [
        ("left", "left_forearm:27", "joint-limits", 0.05),
        ("right", "palm", "manipulability", 0.02),
        ("right", "palm", "isotropy", 0.02),
        ("right", "palm", "approach", 0.02),
    ],
)
def test_labels_are_what_the_whole_curve_says(side, end_point, measure, tolerance):
    rng = np.random.default_rng(SEED)
    hand, params = hand_and_params(ROBOT, side, end_point, measure, PARAMS)
    q = rng.uniform(params.arm_limits.lower_rad, params.arm_limits.upper_rad, (300, 4))
    within = gaze_for_points(ROBOT, hand.forward(q)[0], WIDE)
    gaze = np.concatenate([within[np.isfinite(within[:, 0])], rng.uniform(WIDE.lower, WIDE.upper, (100, 3))])
    labels = ReachOracle(ROBOT, side, params, rng, hand).label(gaze)
    true = best_measure(side, end_point, params, gaze)
    assert np.mean(labels.reachable == np.isfinite(true)) >= 0.99
    agreed = labels.reachable & np.isfinite(true)
    assert agreed.sum() > 20
    off = (labels.optimality - true)[agreed]
    assert np.sqrt(np.mean(off**2)) <= tolerance
    assert true[agreed].min() >= 0
    assert true[agreed].max() <= 1.01  # the greatest manipulability is the greatest of 20 000 sampled


def test_directions_are_spread_evenly():
    directions = DirectionCoverage().directions
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=0.01)
    cap = directions @ np.array([0.6, 0.0, 0.8]) >= np.cos(np.deg2rad(20))
    assert cap.mean() == pytest.approx((1 - np.cos(np.deg2rad(20))) / 2, rel=0.2)  # a cap's share of the sphere


def test_how_a_hand_faces_must_be_known():
    hand, params = hand_and_params(ROBOT, "right", "palm", "approach", PARAMS)
    blind = ReachOracle(ROBOT, "right", params, np.random.default_rng(0), replace(hand, normals=None))
    with pytest.raises(ValueError, match="expected its normals"):
        blind.label(np.deg2rad([[10.0, -20.0, 30.0]]))
