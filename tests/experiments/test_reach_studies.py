"""Reachable-space studies against known truths; `test_bench` runs each of them."""

import numpy as np
import pytest

from learning.reach.map import MapPrediction
from pps_vision.experiments.reach_kinematics import DEVIATIONS, samples
from pps_vision.experiments.reach_truth import scores
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub

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
