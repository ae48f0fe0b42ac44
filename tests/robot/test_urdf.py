"""Robots that cannot be: each is refused in one line, whatever Pinocchio and the readers of meshes would do."""

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pps_vision.errors import InputError
from pps_vision.robot.model import FrameNames, Robot

LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
SPHERE = '<sphere radius="0.04"/>'
TEXT = f"""<robot name="arm">
<link name="base"><visual><geometry>{SPHERE}</geometry></visual></link>
<link name="palm"/>
<joint name="a1" type="revolute"><parent link="base"/><child link="palm"/>
<axis xyz="0 1 0"/>{LIMIT}
</joint>
</robot>
"""
NAMES = FrameNames(left_eye="base", right_eye="base", gaze_joints=(), torso=())
MESH = '<mesh filename="m.dae"/>'
NODES = '<COLLADA version="1.4.1"><library_nodes>{}</library_nodes></COLLADA>'


def robot(folder, old="", new="", mesh=None):
    if mesh is not None:
        (folder / "m.dae").write_text(mesh)
    assert old in TEXT
    (folder / "arm.urdf").write_text(TEXT.replace(old, new, 1))
    return Robot(folder / "arm.urdf", NAMES)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"-2" upper="2"', '"-90" upper="90"', r"arm\.urdf:5: joint 'a1' from -90 to 90; expected .* two turns"),
        ('"-2" upper="2"', '"2" upper="-2"', r"arm\.urdf:5: joint 'a1' from 2 to -2; expected lower ≤ upper"),
        ('"-2" upper="2"', '"nan" upper="2"', r"arm\.urdf:5: limit with lower 'nan'; expected finite numbers"),
        (LIMIT, "", r"arm\.urdf:4: joint 'a1' has no limit; expected lower and upper"),
        ("0 1 0", "0 0 0", r"arm\.urdf:5: joint 'a1' has an axis without length"),
        ("0 1 0", "0 x 0", r"arm\.urdf:5: axis with xyz '0 x 0'; expected finite numbers"),
        (
            "revolute",
            "floating",
            r"arm\.urdf:4: joint 'a1' is floating; expected revolute, continuous, prismatic or fixed",
        ),
        ('"0.04"', '"-0.04"', r"arm\.urdf:2: link 'base' has a sphere of radius -0.04; expected a positive radius"),
        ('"0.04"', '"nan"', r"arm\.urdf:2: sphere with radius 'nan'; expected finite numbers"),
        (SPHERE, '<box size="1 0 1"/>', r"arm\.urdf:2: link 'base' has a box of size 1 0 1"),
        ("<robot", "<!DOCTYPE r [<!ENTITY a 'b'>]><robot", r"arm\.urdf:1: a declaration"),
        ("<robot", "<boat/><robot", r"arm\.urdf:1: cannot be read as URDF"),
        (TEXT, "<boat/>", r"arm\.urdf:1: cannot be read as URDF: <boat>; expected <robot>"),
        (SPHERE, 40 * "<a>" + 40 * "</a>", r"arm\.urdf:2: more than 32 levels"),
        ("</robot>", "".join(f'<link name="l{k}"/>' for k in range(60_000)) + "</robot>", r"60002 links; expected at"),
        (LIMIT, LIMIT + '<mimic joint="a0"/>', r"arm\.urdf:5: joint 'a1' mimics 'a0'; expected a joint that moves"),
    ],
)
def test_a_robot_that_cannot_be(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        robot(tmp_path, old, new)


def test_a_continuous_joint_turns_once(tmp_path):
    turning = robot(tmp_path, 'type="revolute"', 'type="continuous"')
    np.testing.assert_allclose([turning.lower_rad, turning.upper_rad], [[-np.pi], [np.pi]])
    (tmp_path / "arm.urdf").write_text(TEXT.replace("revolute", "continuous").replace(LIMIT, ""))
    assert Robot(tmp_path / "arm.urdf", NAMES).upper_rad == pytest.approx([np.pi])


LINKS = """<link name="tip"/><joint name="a2" type="revolute"><parent link="palm"/><child link="tip"/>
<origin xyz="1 0 0"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>
<mimic joint="a1" multiplier="-2" offset="0.1"/></joint>
<link name="end"/><joint name="e" type="fixed"><parent link="tip"/><child link="end"/><origin xyz="1 0 0"/></joint>
</robot>"""


def test_a_joint_that_mimics_another_follows_it(tmp_path):
    """Two bars of 1 m: their end is at R(q)·(x + R(0.1 − 2q)·x), whatever the configuration says of the second."""
    arm = robot(tmp_path, "</robot>", LINKS)

    def end(q):
        first, second = (Rotation.from_euler("y", angle) for angle in (q, 0.1 - 2 * q))
        return first.apply(np.array([1.0, 0, 0]) + second.apply([1.0, 0, 0]))

    for q in (-0.7, 0.0, 0.4):
        posture = arm.at([q, 5.0])
        np.testing.assert_allclose(posture.point("end"), end(q), atol=1e-12)
        slope = (end(q + 1e-6) - end(q - 1e-6)) / 2e-6
        np.testing.assert_allclose(posture.jacobian("end")[:3], np.stack([slope, np.zeros(3)], axis=1), atol=1e-8)
        position, J = arm.chain(("a1",), "end").positions([[q]])
        np.testing.assert_allclose(position[0], end(q), atol=1e-12)
        np.testing.assert_allclose(J[0, :, 0], slope, atol=1e-8)
        np.testing.assert_allclose(arm.chain(arm.moving("end"), "end").pose(posture.q_rad)[:3, 3], end(q), atol=1e-12)
    assert set(arm.moving("end")) == {"a1", "a2"}


CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 2) for z in (0, 3)) + "f 1 2 3\nf 6 7 8\n"


def test_a_mesh_of_a_package_is_looked_for_where_ros_does(tmp_path, monkeypatch):
    (tmp_path / "urdf").mkdir()
    for place, variable, value in (
        ("src/my_arm", "ROS_PACKAGE_PATH", "src"),
        ("my_arm", "ROS_PACKAGE_PATH", "my_arm"),
        ("src2/stack/my_arm", "ROS_PACKAGE_PATH", "src2"),
        ("opt/share/my_arm", "AMENT_PREFIX_PATH", "opt"),
    ):
        package = tmp_path / "elsewhere" / place
        (package / "meshes").mkdir(parents=True)
        (package / "package.xml").touch()
        (package / "meshes" / "m.obj").write_text(CUBE)
        monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'elsewhere' / value}")
        body = robot(tmp_path / "urdf", SPHERE, '<mesh filename="package://my_arm/meshes/m.obj"/>').bodies[0]
        assert body.size_m == pytest.approx((1, 2, 3))
        monkeypatch.delenv(variable)
    with pytest.warns(UserWarning, match=r"arm\.urdf:2: mesh package://my_arm/meshes/m\.obj is in none of the folders"):
        assert robot(tmp_path / "urdf", SPHERE, '<mesh filename="package://my_arm/meshes/m.obj"/>').bodies == ()


@pytest.mark.parametrize(
    "nodes",
    ['<node id="n"><instance_node url="#n"/></node>', 30_000 * "<node>" + 30_000 * "</node>", "<no node"],
    ids=["contains itself", "deep", "broken"],
)
def test_a_mesh_that_crashes_its_reader_is_named(tmp_path, nodes):
    with pytest.raises(InputError, match=r"m\.dae: cannot be read; expected a mesh"):
        robot(tmp_path, SPHERE, MESH, NODES.format(nodes))


def test_a_mesh_that_is_a_pipe_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "m.dae")
    with pytest.raises(InputError, match=r"m\.dae: is a device, pipe or socket; expected a mesh"):
        robot(tmp_path, SPHERE, MESH)
