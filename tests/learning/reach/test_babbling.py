"""Babbling against the robot's own kinematics."""

import numpy as np
import pytest

from learning.reach.babbling import babble
from learning.reach.params import ArmLimits
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
