"""The gaze read from the joints and written back to them."""

import numpy as np
import pytest

from control.head import gaze_columns, gaze_of, gaze_range
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import home, set_gaze

DEG = np.pi / 180


def test_gaze_columns_move_what_gaze_of_reads(robot):
    q = set_gaze(robot, home(robot), 0.1, -0.2, 0.05, version=0.07, vergence=0.3)
    np.testing.assert_allclose(gaze_of(robot.at(q)), [0.1, -0.2, 0.05, 0.3])
    step = np.array([0.01, 0.02, -0.03, 0.04])
    moved = q + gaze_columns(robot) @ step
    expected = set_gaze(robot, q, 0.11, -0.18, 0.02, version=0.07, vergence=0.34)
    np.testing.assert_allclose(moved, expected, atol=1e-12)


def test_the_range_is_the_narrower_of_js_and_the_robots(robot):
    lower, upper = gaze_range(GazeLimits(), robot.at(np.zeros(robot.n_joints)))
    np.testing.assert_allclose(lower / DEG, [-55, -40, -35, 5])
    np.testing.assert_allclose(upper / DEG, [55, 30, 15, 90])  # J's 40° of pitch, the iCub's 30°


def test_eyes_turned_aside_have_less_room_to_converge(robot):
    """With a version of 20° the left eye's 50° leave 60° of vergence."""
    q = set_gaze(robot, np.zeros(robot.n_joints), version=20 * DEG, vergence=10 * DEG)
    np.testing.assert_allclose(gaze_range(GazeLimits(), robot.at(q))[1][3] / DEG, 60)
    q = set_gaze(robot, np.zeros(robot.n_joints), version=-20 * DEG, vergence=10 * DEG)
    np.testing.assert_allclose(gaze_range(GazeLimits(), robot.at(q))[1][3] / DEG, 60)


@pytest.mark.parametrize(("left", "right"), [(55, 52), (-51, -58)])
def test_with_both_eyes_beyond_their_limits_the_vergence_stays(robot, left, right):
    q = np.zeros(robot.n_joints)
    q[robot.indices(robot.names.gaze_joints[3:])] = left * DEG, right * DEG
    lower, upper = gaze_range(GazeLimits(), robot.at(q))
    assert lower[3] == upper[3] == pytest.approx((left - right) * DEG)
    np.testing.assert_allclose(lower[:3] / DEG, [-55, -40, -35])


def test_js_range_ends_at_the_robots(robot):
    """Eyes turned aside by 49° converge by 2° at most, where J asks for 5°."""
    q = set_gaze(robot, np.zeros(robot.n_joints), version=49 * DEG, vergence=0.0)
    lower, upper = gaze_range(GazeLimits(), robot.at(q))
    np.testing.assert_allclose([lower[3] / DEG, upper[3] / DEG], [2, 2])
