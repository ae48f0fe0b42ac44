"""Babbling against the robot's own kinematics."""

import numpy as np
import pytest

from learning.reach.babbling import Babbled, babble
from learning.reach.labels import ReachOracle
from learning.reach.params import ArmLimits, MapParams
from pps_vision.experiments.reach_truth import gaze_rmse_deg
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub

ROBOT = load_icub()


@pytest.fixture(scope="module")
def babbled():
    return babble(ROBOT, "right", 6000, np.random.default_rng(1))


def test_what_is_fixated_is_the_hand(babbled):
    palms = ROBOT.chain(ROBOT.names.arm("right")[:4], "right_palm").positions(babbled.arm_rad)[0]
    np.testing.assert_allclose(fixation_points(ROBOT, babbled.gaze_rad), palms, atol=1e-6)


def test_limits_decide_what_can_be_fixated(babbled):
    """28 % of the postures can be fixated; none is beyond a limit; narrower limits leave fewer."""
    assert babbled.n_tried == 6000
    assert len(babbled.arm_rad) / babbled.n_tried == pytest.approx(0.28, abs=0.03)
    limits = GazeLimits()
    arm = ArmLimits()
    assert np.all((babbled.gaze_rad >= limits.lower) & (babbled.gaze_rad <= limits.upper))
    assert np.all((babbled.arm_rad >= arm.lower_rad) & (babbled.arm_rad <= arm.upper_rad))
    narrow = GazeLimits(yaw_rad=(-0.1, 0.1))
    few = babble(ROBOT, "right", 500, np.random.default_rng(1), gaze_limits=narrow)
    assert 0 < len(few.arm_rad) < 0.15 * 500


def test_an_unknown_side_is_refused():
    with pytest.raises(ValueError, match="side 'third': expected left or right"):
        babble(ROBOT, "third", 10, np.random.default_rng(0))
    with pytest.raises(ValueError, match="side 'third': expected left or right"):
        ReachOracle(ROBOT, "third", MapParams(n_babble=100), np.random.default_rng(0))


def test_postures_without_an_answer_are_counted_apart():
    """Three of four postures are answered, 0.01 rad off in every angle."""
    arm = np.array([[0.0] * 4] * 3 + [[np.inf] * 4])
    gaze = np.tile([0.1, 0.2, 0.3], (4, 1))

    def model(arm):
        return np.where(np.isfinite(arm[:, :1]), gaze, np.nan)

    assert gaze_rmse_deg(model, Babbled(arm, gaze + 0.01, 4)) == (pytest.approx(np.rad2deg(0.01)), 0.25)
