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


@pytest.mark.parametrize(
    ("left_deg", "right_deg", "vergence_deg"),
    [
        (0, 0, (5, 90)),
        (25, 15, (5, 60)),  # with a version of 20° the left eye's 50° leave 60° of vergence
        (-15, -25, (5, 60)),
        (49, 49, (2, 2)),  # J's range ends at the robot's: by 2° at most, where J asks for 5°
        (55, 52, (3, 3)),  # with both eyes beyond their limits the vergence stays
        (-51, -58, (7, 7)),
    ],
)
def test_the_range_is_the_narrower_of_js_and_the_robots(robot, left_deg, right_deg, vergence_deg):
    q = np.zeros(robot.n_joints)
    q[robot.indices(robot.names.gaze_joints[3:])] = left_deg * DEG, right_deg * DEG
    lower, upper = gaze_range(GazeLimits(), robot.at(q))
    np.testing.assert_allclose(lower / DEG, [-55, -40, -35, vergence_deg[0]])
    np.testing.assert_allclose(upper / DEG, [55, 30, 15, vergence_deg[1]])  # J's 40° of pitch, the iCub's 30°
