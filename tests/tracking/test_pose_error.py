"""How far a moving head carries what it sees, and what that does to a covariance."""

import numpy as np

from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.icub import home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Observation3D
from tracking.pose_error import PoseError, carried

P = np.array([-0.45, 0.03, 0.28])


def test_a_turning_neck_carries_a_point_like_a_rigid_body(robot: Robot, rig: StereoRig) -> None:
    q, rate, dt = home(robot), 0.4, 1e-4
    before, now = rig.view(q), rig.view(set_gaze(robot, q, yaw=rate * dt))
    point_of_head = move_points(before.left.T_camera_root, P)
    expected = (move_points(now.left.T_root_camera, point_of_head) - P) / dt
    np.testing.assert_allclose(carried(before, now, P, dt), expected, rtol=1e-3, atol=1e-5)
    assert np.linalg.norm(expected) > 0.15  # 0.4 rad/s at 0.45 m from the eyes


def test_converging_eyes_carry_a_point_along_the_line_of_sight(robot: Robot, rig: StereoRig) -> None:
    """For two rays that cross under a vergence angle γ at distance z, dz/dγ is about −z²/baseline."""
    q, rate, dt = home(robot), 0.2, 1e-4
    before = rig.view(set_gaze(robot, q, vergence=np.deg2rad(8.0)))
    now = rig.view(set_gaze(robot, q, vergence=np.deg2rad(8.0) + rate * dt))
    eyes = 0.5 * (now.left.center + now.right.center)
    away = (P - eyes) / np.linalg.norm(P - eyes)
    baseline = np.linalg.norm(now.left.center - now.right.center)
    expected = -rate * np.linalg.norm(P - eyes) ** 2 / baseline
    np.testing.assert_allclose(carried(before, now, P, dt) @ away, expected, rtol=0.1)


def test_the_covariance_grows_by_the_stamps_error_along_the_motion_only(robot: Robot, rig: StereoRig) -> None:
    q, rate, dt, error_s = home(robot), 0.4, 0.05, 0.02
    views = rig.view(q), rig.view(set_gaze(robot, q, yaw=rate * dt))
    seen = Observation3D(dt, P, 1e-6 * np.eye(3), 0.03, 1e-6, 0.1)
    pose = PoseError(error_s)
    assert pose.widen(seen, views[0], 0.0) is seen, "one view tells no speed"
    wide = pose.widen(seen, views[1], dt)
    assert wide is not None
    off = error_s * carried(*views, P, dt)
    np.testing.assert_allclose(np.linalg.eigvalsh(wide.cov_root - seen.cov_root), [0, 0, off @ off], atol=1e-12)
    still = pose.widen(seen, views[1], 2 * dt)
    assert still is not None
    np.testing.assert_allclose(still.cov_root, seen.cov_root, atol=1e-15)
