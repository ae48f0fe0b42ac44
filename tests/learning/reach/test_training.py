"""Training from answers made up of a known border: which labels are asked for, kept and believed."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED
from scipy.optimize import least_squares
from scipy.stats import binomtest

from learning.reach.labels import HandModel, Labels, ReachOracle
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import learned_from
from pps_vision.errors import InputError
from pps_vision.experiments.encounters.reaching import train_part_map
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import EndPoint

LIMITS = GazeLimits()
PARAMS = MapParams(n_labels=600, round_labels=200, lattice=0.2)


def plane(gaze, wrong=0.0, failed=0.0, rng=None):
    """Reachable is what lies to the left; a share of the answers is the opposite, to a share there is none."""
    draw = np.ones((2, len(gaze))) if rng is None else rng.random((2, len(gaze)))
    left = gaze[:, 0] < 0
    reachable = left ^ (draw[0] < wrong)
    border = np.where(left[:, None], np.nan, gaze * [0, 1, 1])
    error = np.where(draw[1] < failed, np.nan, np.where(reachable, 0.0, np.abs(gaze[:, 0])))
    return Labels(gaze, reachable, error, np.where(reachable, 0.5, np.nan), border)


def counted(calls, **how):
    def label(gaze):
        calls.append(len(gaze))
        return plane(gaze, **how)

    return label


def test_all_labels_are_spent_round_by_round():
    calls = []
    learned = learned_from(counted(calls), "right", np.random.default_rng(SEED), PARAMS)
    assert calls == [200, 200, 200]
    assert len(learned.labels.gaze_rad) == 600
    assert learned.max_error_m == learned.labels.error_m.max()
    assert learned.softness == pytest.approx(0.5 * PARAMS.lattice**2, rel=0.05)  # all answers as predicted


def test_training_ends_when_the_expected_error_is_small_enough():
    calls = []
    learned = learned_from(counted(calls), "right", np.random.default_rng(SEED), replace(PARAMS, max_error=0.9))
    assert calls[:2] == [200, 200]
    assert len(calls) == 3  # the last ones test the map and are not learned from
    assert len(learned.labels.gaze_rad) == 400


def test_going_on_keeps_what_was_learned_and_does_not_count_it():
    """A tenth of the problems has no answer: counted, and not learned from."""
    rng = np.random.default_rng(SEED)
    calls = []
    first = learned_from(counted([], failed=0.1, rng=rng), "right", rng, PARAMS)
    more = learned_from(counted(calls, failed=0.1, rng=rng), "right", rng, PARAMS, into=first)
    assert calls == [200, 200, 200]
    assert len(more.labels.gaze_rad) + more.unanswered == 1200
    assert more.unanswered > first.unanswered > 30
    np.testing.assert_array_equal(more.labels.gaze_rad[: len(first.labels.gaze_rad)], first.labels.gaze_rad)
    gaze = np.random.default_rng(SEED).uniform(LIMITS.lower, LIMITS.upper, (500, 3))
    assert (first.query(gaze).reachable == (gaze[:, 0] < 0)).mean() > 0.98
    for changes in ({"side": "left"}, {"limits": GazeLimits(vergence_rad=(0.1, 1.0))}):
        with pytest.raises(InputError, match="to continue from"):
            learned_from(plane, "right", rng, PARAMS, into=replace(first, **changes))


def test_where_inverse_kinematics_never_answers_or_all_is_within_reach_nothing_is_learned():
    def label(gaze):
        return replace(plane(gaze), error_m=np.full(len(gaze), np.nan))

    with pytest.raises(InputError, match="inverse kinematics never converged"):
        learned_from(label, "right", np.random.default_rng(SEED), PARAMS)
    with pytest.raises(InputError, match="all 200 labels are within reach"):
        learned_from(lambda gaze: plane(gaze * [0, 1, 1] - [1, 0, 0]), "right", np.random.default_rng(SEED), PARAMS)


def test_the_bound_of_the_error_is_that_of_the_binomial_distribution():
    """By verdicts that contradict the labels in a known strip: the errors of a test of 300 postures are binomial, and
    no bound is given without a test."""
    params = replace(PARAMS, n_test=300)
    tested = []

    def verdicts(gaze):
        tested.append(gaze)
        return (gaze[:, 0] < 0) ^ (gaze[:, 1] < np.quantile(gaze[:, 1], 0.1))

    learned = learned_from(plane, "right", np.random.default_rng(SEED), params, verdicts=verdicts)
    (gaze,) = tested
    wrong = int(np.sum(learned.query(gaze).reachable != verdicts(gaze)))
    assert 15 < wrong < 60
    assert learned.error_bound == pytest.approx(binomtest(wrong, 300).proportion_ci(0.9, "exact").high)
    untested = learned_from(plane, "right", np.random.default_rng(SEED), replace(params, n_test=0))
    assert untested.error_bound == 1.0
    opposite = learned_from(
        plane, "right", np.random.default_rng(SEED), params, verdicts=lambda gaze: ~untested.query(gaze).reachable
    )
    assert opposite.error_bound == 1.0


def test_a_test_that_fails_leaves_less_risk_to_the_next():
    """Verdicts that are wrong in one of 20 postures, then right: the first test fails, the second has a quarter of the
    risk, and so a bound of 1 − (0.05 / 4)^(1/n) without errors."""
    params = replace(PARAMS, n_labels=3000, max_error=0.03)
    right = learned_from(plane, "right", np.random.default_rng(0), replace(params, max_error=0.0))
    tests = []

    def verdicts(gaze):
        tests.append(len(gaze))
        return right.query(gaze).reachable ^ ((np.arange(len(gaze)) % 20 == 0) & (len(tests) == 1))

    learned = learned_from(plane, "right", np.random.default_rng(SEED), params, verdicts=verdicts)
    assert tests == [334, 334]
    assert 1 - (0.05 / 4) ** (1 / 334) - 1e-9 <= learned.error_bound <= 0.03


def oracle_of(place, tried=None):
    """One whose gaze and points are the same numbers, and whose hand is at `place` of joints 1 and 2 and at joint 3."""

    def forward(q):
        (x, slope) = place(q[:, 0], q[:, 1])
        J = np.zeros((len(q), 3, 4))
        J[:, :2, :2] = np.moveaxis(np.array(slope) * np.eye(2)[:, :, None], 2, 0)
        J[:, 2, 2] = 1
        return np.column_stack([*x, q[:, 2]]), J

    hand = HandModel(forward, lambda gaze: gaze, lambda points, _: points, tried)
    return ReachOracle(load_icub(), "right", replace(PARAMS, n_babble=500), np.random.default_rng(SEED), hand)


def test_labels_of_a_hand_in_a_box_by_hand():
    """Joints are places: beyond the box the nearest point is its side, edge or corner."""
    low = np.array(ArmLimits().lower_rad)[:3]
    high = np.array(ArmLimits().upper_rad)[:3]
    gaze = np.random.default_rng(SEED).uniform(low - 0.5, high + 0.5, (200, 3))
    labels = oracle_of(lambda a, b: ((a, b), (1 + 0 * a, 1 + 0 * b))).label(gaze)
    nearest = gaze.clip(low, high)
    inside = (gaze == nearest).all(axis=1)
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_array_equal(labels.reachable, inside)
    np.testing.assert_allclose(labels.error_m[~inside], np.linalg.norm(gaze - nearest, axis=1)[~inside], atol=1e-6)
    np.testing.assert_allclose(labels.border_rad[~inside], nearest[~inside], atol=1e-3)
    assert np.isnan(labels.border_rad[inside]).all()
    assert np.isnan(labels.optimality[~inside]).all()


def test_what_one_of_sixteen_near_postures_reaches_is_reachable():
    """Joint 2 lifts the hand to 0.3 m at 0.5 rad, lowers it until 1 rad, then lifts it higher; fifteen are caught."""

    def place(a, b):
        first = b < 1
        rise = np.where(first, 0.3 * np.sin(np.pi * b), b - 1)
        return (a, rise), (1 + 0 * a, np.where(first, 0.3 * np.pi * np.cos(np.pi * b), 1.0))

    caught = np.array([-0.5, 0.45, 0.2, 0.5])
    free = np.array([-0.5, 1.2, 0.2, 0.5])
    ask = np.array([[-0.5, 0.39, 0.2], [-0.5, 0.42, 0.2]])
    fifteen = np.tile(caught, (15, 1))
    assert oracle_of(place, np.vstack([fifteen, free])).verdicts(ask).tolist() == [True, False], "0.12 m is too far"
    assert oracle_of(place, np.vstack([fifteen, caught])).verdicts(ask).tolist() == [False, False]


def test_answers_that_contradict_their_neighbours_are_not_believed():
    """One answer of 20 is wrong; half a radian from the border the map is right all the same.  The expected error is
    that of all postures, a tenth of which lies in the band about the border."""
    rng = np.random.default_rng(SEED)
    params = replace(PARAMS, n_labels=6000, round_labels=2000, lattice=0.1)
    learned = learned_from(lambda gaze: plane(gaze, 0.05, rng=rng), "right", rng, params)
    gaze = rng.uniform(LIMITS.lower, LIMITS.upper, (4000, 3))
    gaze = gaze[np.abs(gaze[:, 0]) > 0.5]
    np.testing.assert_array_equal(learned.query(gaze).reachable, gaze[:, 0] < 0)
    low, high = params.border_band
    band = (high - low) / (LIMITS.upper[0] - LIMITS.lower[0])
    assert band == pytest.approx(0.1, abs=0.01)
    assert 0.04 * band < learned.expected_error < 0.1 * band  # some right answers are not predicted either


def test_the_map_of_a_body_part_knows_how_far_its_nearest_taxel_gets():
    """Against least squares by SciPy with the robot's own chain, to 3 mm."""
    robot = load_icub()
    taxels = ("left_palm:101", "left_palm:134")
    limits = GazeLimits((-0.9, 0.5), (-1.6, -0.3), (0.12, 0.5))
    params = MapParams(limits, ArmLimits.of(robot, "left"), 600, 300, n_babble=5000, lattice=0.06, exact_m=0.1)
    rng = np.random.default_rng(SEED)
    learned = train_part_map(robot, "left", taxels, rng, params)
    gaze = rng.uniform(limits.lower, limits.upper, (300, 3))
    left_m = (1 - 2 * learned.query(gaze).degree) * learned.max_error_m
    near = np.flatnonzero((left_m > 0.01) & (left_m < 0.09))[:6]
    points = GazeModel(robot).points(gaze[near])
    hands = [EndPoint.of(robot, "left", taxel, 7) for taxel in taxels]
    bounds = params.arm_limits.lower_rad, params.arm_limits.upper_rad
    starts = rng.uniform(*bounds, (4, 7))

    def least_m(point):
        misses = [lambda q, hand=hand: hand.positions(q[None])[0][0] - point for hand in hands]
        return min(np.linalg.norm(least_squares(miss, q, bounds=bounds).fun) for miss in misses for q in starts)

    exact = [least_m(point) for point in points]
    assert np.median(np.abs(left_m[near] - exact)) < 0.003
