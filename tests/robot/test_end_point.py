"""The point of an arm that reaches: by Pinocchio's frames."""

import numpy as np
import pytest

from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import EndPoint, Skin, icub_skin

ROBOT = load_icub()


@pytest.mark.parametrize(("name", "k"), [("palm", None), ("left_palm:99", 13), ("left_forearm:51", 11)])
@pytest.mark.parametrize("n_joints", [4, 7])
def test_position_jacobian_and_normal_of_a_point_of_the_arm(name, k, n_joints):
    """The palm's point is its frame's origin, whose taxels face along −z."""
    skin = icub_skin(("left_forearm", "left_palm"))
    point = EndPoint.of(ROBOT, "left", name, n_joints)
    joints = ROBOT.indices(ROBOT.names.arm("left")[:n_joints])
    q = np.zeros(ROBOT.n_joints)
    arm = np.linspace(0.1, 0.4, n_joints)
    q[joints] = arm
    posture = ROBOT.at(q)
    T = posture.T_root("left_palm")
    expected, normal = (T[:3, 3], -T[:3, 2]) if k is None else (vectors[k] for vectors in skin.at(posture))
    (position,), (J,) = point.positions(arm[None])
    np.testing.assert_allclose(position, expected, atol=1e-12)
    np.testing.assert_allclose(point.normals(arm[None])[0], normal, atol=1e-3)
    h = 1e-6 * np.eye(n_joints)
    differences = (point.positions(arm + h)[0] - point.positions(arm - h)[0]) / 2e-6
    np.testing.assert_allclose(J, differences.T, atol=1e-8)


def test_a_palm_without_taxels_faces_along_its_z_axis():
    point = EndPoint.of(ROBOT, "right", "palm", 7, Skin(icub_skin(("right_forearm",)).parts))
    np.testing.assert_array_equal(point.normal, [0.0, 0.0, 1.0])


def test_what_is_no_point_of_the_arm_is_answered_with_those_that_are():
    for name in ("elbow", "right_forearm:27"):
        with pytest.raises(ValueError, match=f"'{name}' of the left arm; expected palm or one of left_forearm:27, "):
            EndPoint.of(ROBOT, "left", name, 7)
