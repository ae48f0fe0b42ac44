"""Reachable-space studies against known truths; `test_bench` runs each of them."""

from types import SimpleNamespace

import numpy as np
import pytest
from documents import ROOT

from learning.reach.babbling import gaze_at_hand, random_arms
from learning.reach.map import MapPrediction
from pps_vision.experiments.reach_in_loop import judge
from pps_vision.experiments.reach_kinematics import ReachKinematics
from pps_vision.experiments.reach_kinematics.deviations import DEVIATIONS, samples
from pps_vision.experiments.reach_paper.figures import to_root, to_simulator
from pps_vision.experiments.reach_truth import MapTruth, first, scores
from pps_vision.experiments.severity.reach import DISTURBANCES, LEARNERS, disturbed, learn_and_judge
from pps_vision.experiments.tables import read_numbers
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.types import Reachability, ReachStatus

ROBOT = load_icub()
NAN = np.nan


def test_scores_of_a_known_map() -> None:
    """Four reachable of which one is missed, one unreachable of which none is; R is off by 0.1 where it is known."""
    yes = np.array([True, True, True, False, False])
    degree = np.array([0.9, 0.8, 0.7, 0.4, 0.2])
    prediction = MapPrediction(yes, yes, yes.astype(float), degree + np.array([0.1, -0.1, 0.1, -0.1, NAN]))
    result = scores(prediction, np.array([True, True, True, True, False]), degree)
    assert result == {"je": 20, "fn": 25, "fp": 0, "degree_rmse": pytest.approx(0.1)}


def test_both_hands_reach_as_the_worse_of_them_does() -> None:
    """Both; one; neither; one, the other's distance unknown."""
    gaze = np.arange(12.0).reshape(4, 3)

    def truth(reachable: list[bool], optimality: list[float], error_m: list[float]) -> MapTruth:
        return MapTruth(gaze, np.array(reachable), np.array(optimality), np.array(error_m), gaze, np.array(reachable))

    left = truth([True, True, False, True], [0.6, 0.5, NAN, 0.4], [NAN, NAN, 0.2, NAN])
    worse = left.with_arm(truth([True, False, False, False], [0.3, NAN, NAN, NAN], [NAN, 0.1, 0.5, NAN]))
    np.testing.assert_array_equal(worse.reachable, [True, False, False, False])
    np.testing.assert_array_equal(worse.box_reachable, worse.reachable)
    np.testing.assert_array_equal(worse.optimality, [0.3, NAN, NAN, NAN])
    np.testing.assert_array_equal(worse.error_m, [NAN, 0.1, 0.5, NAN])


def test_simulator_coordinates_are_those_of_the_public_code() -> None:
    """J's box in the root frame, as the maps are judged in it."""
    corners = to_root(np.array([[-0.10, 0.75, 0.20], [0.10, 0.95, 0.35]]))
    np.testing.assert_allclose(corners, [[-0.226, 0.10, 0.1524], [-0.376, -0.10, 0.3524]])
    np.testing.assert_allclose(to_simulator(corners), [[-0.10, 0.75, 0.20], [0.10, 0.95, 0.35]])


@pytest.mark.parametrize("deviation", DEVIATIONS)
def test_the_eyes_of_the_deviating_head_meet_at_the_deviating_hand(deviation: str) -> None:
    bend, head = DEVIATIONS[deviation]
    babbled = samples(deviation, 300, np.random.default_rng(1))
    arm = ROBOT.chain(ROBOT.names.arm("right")[:4], "right_palm")
    hand = arm.positions(bend(arm, babbled.arm_rad))[0]
    assert len(hand) > 50
    np.testing.assert_allclose(head().points(babbled.gaze_rad), hand, atol=1e-6)
    ideal = np.linalg.norm(fixation_points(ROBOT, babbled.gaze_rad) - hand, axis=1)
    assert (np.median(ideal) > 1e-3) == (
        deviation not in ("none", "sag of up to 2°", "gears, 0.5° sin 8q", "cross-talk, 1.5 %")
    )
    unbent = np.linalg.norm(arm.positions(babbled.arm_rad)[0] - hand, axis=1)
    assert (np.median(unbent) > 5e-4) == (
        deviation not in ("none", "neck yaw below pitch", "neck yaw axis tilted by 5°")
    )


def test_the_official_models_differ_from_ours_as_published() -> None:
    pytest.importorskip("icub_models")
    published = read_numbers(ROOT / "docs" / "results" / "reach_kinematics.json")["official_icub"]["models"]
    models = ReachKinematics(parts=("official_icub",)).run()["official_icub"]["models"]
    assert list(models) == list(published)
    for name, rows in models.items():
        assert [row["joint"] for row in rows] == [row["joint"] for row in published[name]]
        for key in ("offset_m", "limits_deg", "our_limits_deg"):
            for ours, theirs in zip(rows, published[name], strict=True):
                assert ours[key] == pytest.approx(theirs[key], rel=1e-4, abs=1e-6)
        assert max(row["angle_deg"] for row in rows) < 0.01


def test_verdicts_in_the_loop_are_counted_at_the_true_position() -> None:
    """The left palm's own position is reachable; 2 m ahead nothing is; behind the head nothing can be fixated."""
    limits = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    arms = random_arms(200, np.random.default_rng(1))
    arm = arms[np.isfinite(gaze_at_hand(ROBOT, "left", arms, limits)[:, 0])][0]
    q = np.zeros(ROBOT.n_joints)
    q[ROBOT.indices(ROBOT.names.arm("left")[:4])] = arm
    near = ROBOT.at(q).point("left_palm")
    truth = np.array([near, near, [-2.0, 0.0, 0.3], [0.5, 0.0, 0.3], near])
    statuses = ("REACHABLE", "UNREACHABLE", "REACHABLE", "NOT_FIXATED", "UNKNOWN")
    answers = [Reachability(0.0, np.full(3, NAN), 0.5, 0.5, ReachStatus[status]) for status in statuses]
    learned = SimpleNamespace(query=lambda gaze: MapPrediction(*[np.isfinite(gaze[:, 0])] * 4))
    values = judge(ROBOT, learned, SimpleNamespace(reachability=answers, truth_m=truth))
    np.testing.assert_array_equal(values["right"], [True, False, False, True])
    np.testing.assert_array_equal(values["right_at_true_position"], True)
    nothing = judge(ROBOT, learned, SimpleNamespace(reachability=answers[4:], truth_m=truth[4:]))
    assert {len(value) for value in nothing.values()} == {0}


def test_the_first_severity_changes_nothing_and_the_last_does() -> None:
    for name, (axis, _) in DISTURBANCES.items():
        none, worst = (disturbed(name, 10, 3, axis.severities[k]) for k in (0, -1))
        ideal = disturbed("labels flipped", 10, 3, 0)
        np.testing.assert_array_equal(none.babbled.arm_rad, ideal.babbled.arm_rad, err_msg=name)
        np.testing.assert_allclose(none.babbled.gaze_rad, ideal.babbled.gaze_rad, err_msg=name)
        assert none.flipped == 0
        changed = len(worst.babbled.arm_rad) != len(ideal.babbled.arm_rad) or not (
            np.allclose(worst.babbled.arm_rad, ideal.babbled.arm_rad)
            and np.allclose(worst.babbled.gaze_rad, ideal.babbled.gaze_rad)
        )
        assert changed or worst.flipped > 0, name


def test_a_quarter_of_outliers_breaks_the_method_of_j_but_not_ours() -> None:
    data = disturbed("another object fixated", 500, 3, 25)
    ours, of_j = (np.mean(learn_and_judge(name, 200, data, 3)["misjudged"]) for name in LEARNERS)
    assert ours < 0.05
    assert ours < 0.5 * of_j


def test_past_the_break_every_posture_still_has_a_verdict() -> None:
    data = disturbed("fewer samples", 500, 3, 12)
    for learner in LEARNERS:
        values = learn_and_judge(learner, 200, data, 3)
        assert len(values["misjudged"]) == len(data.gaze_rad)
        assert np.mean(values["misjudged"]) > 0.05
    assert len(first(data.babbled, 5).arm_rad) == 5
