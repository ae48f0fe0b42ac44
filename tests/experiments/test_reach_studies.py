"""Reachable-space studies and their baselines against known truths."""

import numpy as np
import pytest
from data import SEED

from learning.reach.map import MapPrediction
from pps_vision.experiments.baselines.ipopt import two_stage_by_ipopt
from pps_vision.experiments.reach_kinematics import DEVIATIONS, samples
from pps_vision.experiments.reach_truth import closed_form, scores
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits, TwoStageParams

ROBOT = load_icub()
NAN = np.nan


def test_scores_of_a_known_map():
    """Four reachable of which one is missed, one unreachable of which none is; R is off by 0.1 where it is known."""
    yes = np.array([True, True, True, False, False])
    degree = np.array([0.9, 0.8, 0.7, 0.4, 0.2])
    prediction = MapPrediction(yes, yes, yes.astype(float), degree + np.array([0.1, -0.1, 0.1, -0.1, NAN]))
    result = scores(prediction, np.array([True, True, True, True, False]), degree)
    assert result == {"je": 20, "fn": 25, "fp": 0, "degree_rmse": pytest.approx(0.1)}


@pytest.mark.parametrize("deviation", DEVIATIONS)
def test_the_eyes_of_the_deviating_head_meet_at_the_deviating_hand(deviation):
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


def test_the_best_posture_is_found_within_reach_and_none_out_of_it():
    """Points that are more than a millimetre from the border of the reachable space."""
    arm = closed_form(ROBOT, "left")
    chain = ROBOT.chain(ROBOT.names.arm("left")[:4], "left_palm")
    measure = FarFromLimits(arm.lower_rad, arm.upper_rad)
    rng = np.random.default_rng(SEED)
    points = arm.shoulder + rng.uniform(-0.3, 0.3, (8, 3))
    starts = rng.uniform(arm.lower_rad, arm.upper_rad, (2, 8, 4))
    around = points[:, None] + 1e-3 * np.concatenate([np.eye(3), -np.eye(3)])
    near = np.isfinite(arm.solve(around.reshape(-1, 3))[:, 0]).reshape(len(points), 6)
    certain = near.all(axis=1) | ~near.any(axis=1)
    solution = two_stage_by_ipopt(chain, points, starts, measure, TwoStageParams())
    _, effort = arm.least_effort(points)
    reachable = np.isfinite(effort)
    assert not (solution.reachable & ~reachable & certain).any()
    assert solution.reachable[reachable & certain].mean() >= 0.5, "two starts do not find all"
    reached = solution.reachable & reachable
    assert reached.any()
    assert (solution.quality[reached] <= 1 - effort[reached] + 5e-3).all()
    assert np.linalg.norm(chain.positions(solution.q_rad[reached])[0] - points[reached], axis=1).max() <= 1e-4
    np.testing.assert_allclose(solution.quality[reached], measure(solution.q_rad[reached], None), atol=1e-12)
