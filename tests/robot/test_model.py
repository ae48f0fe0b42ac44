"""Any robot: frames, Jacobians and bodies of a small arm we can compute by hand, and every guard."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from urdf import joint, write_urdf

from pps_vision.errors import InputError
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import FrameNames, Robot

PLANAR_NAMES = FrameNames(
    left_eye="eye_l",
    right_eye="eye_r",
    palms=("hand", "hand"),
    index_tips=("hand", "hand"),
    gaze_joints=("pan", "nod", "look", "pan_l", "pan_r"),
    left_arm=("arm_1", "arm_2"),
    right_arm=(),
)


def planar_urdf(folder: Path, extra: str = "") -> Path:
    """A planar two-joint arm (links 0.3 and 0.2 m along x, axes z) and a head with two eyes."""
    return write_urdf(
        folder / "planar.urdf",
        joint("arm_1", "base", "upper"),
        joint("arm_2", "upper", "lower", "0.3 0 0"),
        '<joint name="grip" type="fixed"><parent link="lower"/><child link="hand"/>'
        '<origin xyz="0.2 0 0" rpy="0 0 0"/></joint>'
        '<link name="hand"><visual><origin xyz="0.01 0 0" rpy="0 0 0"/><geometry>'
        '<box size="0.02 0.04 0.06"/></geometry>'
        '<material name="green"><color rgba="0 1 0 1"/></material></visual></link>',
        joint("pan", "base", "neck", "0 0 1"),
        joint("nod", "neck", "skull", axis="0 1 0"),
        joint("look", "skull", "sight", axis="0 1 0"),
        joint("pan_l", "sight", "eye_l", "0 0.05 0"),
        joint("pan_r", "sight", "eye_r", "0 -0.05 0"),
        extra,
    )


def test_postures_share_nothing_while_they_live_and_leave_nothing_behind():
    """Their evaluations are used again, which no other posture notices."""
    rng = np.random.default_rng(0)
    robot = load_icub()
    some = rng.uniform(robot.lower_rad, robot.upper_rad, (6, robot.n_joints))
    fresh = load_icub()
    expected = [(p.T_root("left_palm"), p.jacobian("left_palm")) for p in [fresh.at(q) for q in some]]
    for _ in range(2):
        held = [robot.at(q) for q in some[:3]]
        for k in (3, 4, 5):
            passing = robot.at(some[k])
            np.testing.assert_array_equal(passing.T_root("left_palm"), expected[k][0])
            np.testing.assert_array_equal(passing.jacobian("left_palm"), expected[k][1])
        T = [posture.T_root("left_palm") for posture in held]
        np.testing.assert_array_equal(T, [pose for pose, _ in expected[:3]])
        del held, passing
        robot.at(some[5])
        np.testing.assert_array_equal(T, [pose for pose, _ in expected[:3]])
    assert 0 < len(robot.spare_data) < 12


def test_another_robot_is_used_by_naming_its_frames(tmp_path):
    robot = Robot(planar_urdf(tmp_path), PLANAR_NAMES)
    q = np.zeros(robot.n_joints)
    first, second = robot.indices(robot.names.arm("left"))
    q[first] = 0.4
    q[second] = -1.1
    posture = robot.at(q)
    elbow = 0.3 * np.array([np.cos(0.4), np.sin(0.4), 0])
    hand = elbow + 0.2 * np.array([np.cos(-0.7), np.sin(-0.7), 0])
    np.testing.assert_allclose(posture.point("hand"), hand, atol=1e-12)
    np.testing.assert_allclose(posture.point("lower"), elbow, atol=1e-12)
    J = posture.jacobian("hand")
    np.testing.assert_allclose(J[:, first], [-hand[1], hand[0], 0, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(J[:, second], [-(hand - elbow)[1], (hand - elbow)[0], 0, 0, 0, 1], atol=1e-12)
    left, right = robot.eye_poses(q)
    np.testing.assert_allclose(left[:3, 3], [0, 0.05, 1])
    np.testing.assert_allclose(right[:3, 3], [0, -0.05, 1])
    robot.eye_poses(q + 0.3)
    np.testing.assert_array_equal(left, robot.at(q).T_root("eye_l"))  # the later evaluation left it alone


def test_bodies_are_the_urdfs_visuals_in_their_own_links(tmp_path):
    (body,) = Robot(planar_urdf(tmp_path), PLANAR_NAMES).bodies
    assert (body.frame, body.shape) == ("hand", "box")
    np.testing.assert_allclose(body.size_m, (0.02, 0.04, 0.06))
    np.testing.assert_allclose(body.T_frame_body[:3, 3], (0.01, 0, 0), atol=1e-12)
    assert body.color == pytest.approx((0.0, 1.0, 0.0), abs=0.01)


def test_bodies_have_the_sizes_that_the_urdf_gives_them(robot):
    """Radius and whole length of a cylinder, radius of a sphere, sides of a box."""
    sizes = {body.name: body.size_m for body in robot.bodies}
    assert sizes["left_upper_arm_0"] == pytest.approx((0.034, 0.13))
    assert sizes["left_upper_arm_1"] == pytest.approx((0.042,))
    assert sizes["chest_0"] == pytest.approx((0.11, 0.14, 0.16))


def test_a_posture_keeps_its_own_numbers(robot):
    q = np.zeros(robot.n_joints)
    posture = robot.at(q)
    displaced = robot.at(q + 0.1)
    palm = posture.point("left_palm")
    q[:] = 0.5
    np.testing.assert_array_equal(posture.point("left_palm"), palm)
    assert not np.allclose(displaced.point("left_palm"), palm)
    for frozen in (posture.q_rad, robot.lower_rad, robot.upper_rad):
        with pytest.raises(ValueError, match="read-only"):
            frozen[0] = 0.0


def test_frames_it_does_not_have_are_named(tmp_path):
    with pytest.raises(InputError, match=r"planar\.urdf: lacks left_eye, right_eye, neck_yaw.*FrameNames"):
        Robot(planar_urdf(tmp_path))


def test_a_mesh_is_a_body_of_its_bounding_box(tmp_path):
    mesh = tmp_path / "nose.stl"
    trimesh.creation.box((0.2, 0.4, 0.6)).apply_translation((1.0, 0.0, 0.0)).export(mesh)
    nose = (
        f'<link name="nose"><visual><origin xyz="0 0 1"/><geometry><mesh filename="{mesh}" scale="1 1 0.5"/></geometry>'
        '</visual></link><joint name="glue" type="fixed"><parent link="base"/><child link="nose"/></joint>'
    )
    robot = Robot(planar_urdf(tmp_path, nose), PLANAR_NAMES)
    body = next(body for body in robot.bodies if body.frame == "nose")
    assert (body.shape, body.size_m) == ("box", pytest.approx((0.2, 0.4, 0.3)))
    np.testing.assert_allclose(body.T_frame_body[:3, 3], [1.0, 0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("q", [np.zeros(3), np.full(23, np.nan), np.full(23, np.inf), np.zeros((23, 1))])
def test_a_posture_of_wrong_length_or_not_finite_is_refused(robot, q):
    with pytest.raises(ValueError, match="expected 23 finite angles"):
        robot.at(q)


def test_unknown_names_are_answered_with_the_known_ones(robot):
    with pytest.raises(ValueError, match=r"no joint 'tail'; this robot has torso_pitch"):
        robot.indices(("neck_yaw", "tail"))
    posture = robot.at(np.zeros(23))
    for question in (posture.T_root, posture.jacobian):
        with pytest.raises(ValueError, match=r"no frame 'tail'; this robot has .*left_palm"):
            question("tail")


def test_eyes_that_move_need_joints(robot):
    with pytest.raises(ValueError, match="carries no joints"):
        robot.eye_poses(None)
