"""Batched kinematics against Pinocchio, posture by posture."""

import numpy as np
import pytest
from urdf import joint, write_urdf

from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.model import FrameNames, Robot

ROBOT = load_icub()


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
