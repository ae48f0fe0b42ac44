"""Any robot: frames, Jacobians and bodies of a small arm we can compute by hand, and every guard."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

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


def revolute(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="1" velocity="1"/></joint><link name="{child}"/>'
    )


def planar_urdf(folder: Path, extra: str = "", first_joint: str = "revolute") -> Path:
    """A planar two-joint arm (links 0.3 and 0.2 m along x, axes z) and a head with two eyes."""
    urdf = folder / "planar.urdf"
    urdf.write_text(
        '<?xml version="1.0"?><robot name="planar"><link name="base"/>'
        + revolute("arm_1", "base", "upper", "0 0 0", "0 0 1", first_joint)
        + revolute("arm_2", "upper", "lower", "0.3 0 0", "0 0 1")
        + '<joint name="grip" type="fixed"><parent link="lower"/><child link="hand"/>'
        '<origin xyz="0.2 0 0" rpy="0 0 0"/></joint>'
        '<link name="hand"><visual><origin xyz="0.01 0 0" rpy="0 0 0"/><geometry>'
        '<box size="0.02 0.04 0.06"/></geometry>'
        '<material name="green"><color rgba="0 1 0 1"/></material></visual></link>'
        + revolute("pan", "base", "neck", "0 0 1", "0 0 1")
        + revolute("nod", "neck", "skull", "0 0 0", "0 1 0")
        + revolute("look", "skull", "sight", "0 0 0", "0 1 0")
        + revolute("pan_l", "sight", "eye_l", "0 0.05 0", "0 0 1")
        + revolute("pan_r", "sight", "eye_r", "0 -0.05 0", "0 0 1")
        + extra
        + "</robot>"
    )
    return urdf


@pytest.fixture(scope="module")
def icub() -> Robot:
    return load_icub()


def test_postures_share_nothing_while_they_live_and_leave_nothing_behind(icub):
    """Their evaluations are used again, which no other posture notices."""
    rng = np.random.default_rng(0)
    some = rng.uniform(icub.lower_rad, icub.upper_rad, (6, icub.n_joints))
    fresh = load_icub()
    expected = [(p.T_root("left_palm"), p.jacobian("left_palm")) for p in [fresh.at(q) for q in some]]
    for _ in range(2):
        held = [icub.at(q) for q in some[:3]]
        for k in (3, 4, 5):
            passing = icub.at(some[k])
            np.testing.assert_array_equal(passing.T_root("left_palm"), expected[k][0])
            np.testing.assert_array_equal(passing.jacobian("left_palm"), expected[k][1])
        T = [posture.T_root("left_palm") for posture in held]
        np.testing.assert_array_equal(T, [pose for pose, _ in expected[:3]])
        del held, passing
        icub.at(some[5])
        np.testing.assert_array_equal(T, [pose for pose, _ in expected[:3]])
    assert 0 < len(icub.spare_data) < 12


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


def test_bodies_have_the_sizes_that_the_urdf_gives_them(icub):
    """Radius and whole length of a cylinder, radius of a sphere, sides of a box."""
    sizes = {body.name: body.size_m for body in icub.bodies}
    assert sizes["left_upper_arm_0"] == pytest.approx((0.034, 0.13))
    assert sizes["left_upper_arm_1"] == pytest.approx((0.042,))
    assert sizes["chest_0"] == pytest.approx((0.11, 0.14, 0.16))


def test_a_posture_keeps_its_own_numbers(icub):
    q = np.zeros(icub.n_joints)
    posture = icub.at(q)
    displaced = icub.at(q + 0.1)
    palm = posture.point("left_palm")
    q[:] = 0.5
    np.testing.assert_array_equal(posture.point("left_palm"), palm)
    assert not np.allclose(displaced.point("left_palm"), palm)
    for frozen in (posture.q_rad, icub.lower_rad, icub.upper_rad):
        with pytest.raises(ValueError, match="read-only"):
            frozen[0] = 0.0


def test_clamp_stays_within_the_limits(icub):
    np.testing.assert_array_equal(icub.clamp(np.full(icub.n_joints, 10.0)), icub.upper_rad)
    np.testing.assert_array_equal(icub.clamp(np.full(icub.n_joints, -10.0)), icub.lower_rad)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"broken\.urdf: cannot be read: No such file"),
        ("not xml", r"broken\.urdf:1: cannot be read as URDF"),
        ("<?xml version='1.0'?><boat/>", r"broken\.urdf:1: cannot be read as URDF"),
    ],
)
def test_what_is_no_urdf_is_named(tmp_path, text, message):
    if text is not None:
        (tmp_path / "broken.urdf").write_text(text)
    with pytest.raises(InputError, match=message):
        Robot(tmp_path / "broken.urdf")


def test_joints_of_more_than_one_number_and_frames_it_does_not_have_are_named(tmp_path):
    with pytest.raises(InputError, match="joint 'arm_1' is continuous; expected revolute"):
        Robot(planar_urdf(tmp_path, first_joint="continuous"), PLANAR_NAMES)
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
def test_a_posture_of_wrong_length_or_not_finite_is_refused(icub, q):
    with pytest.raises(ValueError, match="expected 23 finite angles"):
        icub.at(q)


def test_unknown_names_are_answered_with_the_known_ones(icub):
    with pytest.raises(ValueError, match=r"no joint 'tail'; this robot has torso_pitch"):
        icub.indices(("neck_yaw", "tail"))
    posture = icub.at(np.zeros(23))
    for question in (posture.T_root, posture.jacobian):
        with pytest.raises(ValueError, match=r"no frame 'tail'; this robot has .*left_palm"):
            question("tail")


def test_eyes_that_move_need_joints(icub):
    with pytest.raises(ValueError, match="carries no joints"):
        icub.eye_poses(None)
