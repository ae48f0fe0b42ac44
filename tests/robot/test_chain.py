"""Batched kinematics against Pinocchio, posture by posture."""

import numpy as np
import pytest
from urdf import joint, write_urdf

from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.model import FrameNames, Robot

ROBOT = load_icub()
CHAINS = [
    (ROBOT.names.arm("left"), "left_palm"),
    (("torso_yaw", "torso_pitch", "torso_roll", *ROBOT.names.arm("right")), "right_index_tip"),  # any order
    (("right_elbow", "right_shoulder_pitch"), "right_forearm"),  # not all, not in order
    (("neck_yaw", "neck_pitch", "left_eye_pan"), "left_eye"),
    (("neck_yaw", "left_elbow"), "right_eye"),  # one that does not move the frame
]


@pytest.mark.parametrize(("joints", "frame"), CHAINS)
def test_positions_frames_and_jacobians(joints, frame):
    rng = np.random.default_rng(0)
    base = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
    point = rng.normal(size=3) * 0.1
    indices = ROBOT.indices(joints)
    q = rng.uniform(-np.pi, np.pi, (20, len(joints)))
    chain = ROBOT.chain(joints, frame, base)
    rotations, origins = chain.frames(q)
    positions, jacobians = chain.positions(q, point)
    for i in range(len(q)):
        full = base.copy()
        full[indices] = q[i]
        posture = ROBOT.at(full)
        T = posture.T_root(frame)
        np.testing.assert_allclose(rotations[i], T[:3, :3], atol=1e-12)
        np.testing.assert_allclose(origins[i], T[:3, 3], atol=1e-12)
        np.testing.assert_allclose(positions[i], posture.point(frame, point), atol=1e-12)
        np.testing.assert_allclose(jacobians[i], posture.jacobian(frame, point)[:3, indices], atol=1e-12)


def test_a_sliding_joint_too(tmp_path):
    turn = joint("turn", "base", "turned", "0.1 0.2 0", rpy="0.3 0 0")
    slide = joint("slide", "turned", "slid", "0.1 0.2 0", "0 1 1", "prismatic", "0.3 0 0")
    robot = Robot(
        write_urdf(tmp_path / "slider.urdf", turn, slide), FrameNames("base", "base", gaze_joints=(), torso=())
    )
    q = np.random.default_rng(1).uniform(-1, 1, (5, 2))
    positions, jacobians = robot.chain(("turn", "slide"), "slid").positions(q)
    indices = robot.indices(("turn", "slide"))
    for i in range(5):
        full = np.zeros(robot.n_joints)
        full[indices] = q[i]
        np.testing.assert_allclose(positions[i], robot.at(full).point("slid"), atol=1e-12)
        np.testing.assert_allclose(jacobians[i], robot.at(full).jacobian("slid")[:3, indices], atol=1e-12)


def test_wrong_shapes_and_names_are_refused():
    chain = ROBOT.chain(ROBOT.names.arm("left"), "left_palm", home(ROBOT))
    with pytest.raises(ValueError, match=r"expected \(N, 7\)"):
        chain.positions(np.zeros(7))
    with pytest.raises(ValueError, match="no joint 'left_knee'"):
        ROBOT.chain(("left_knee",), "left_palm")
    with pytest.raises(ValueError, match="no frame 'left_foot'"):
        ROBOT.chain(("left_elbow",), "left_foot")
