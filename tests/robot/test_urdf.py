"""Robots that cannot be: each is refused in one line, whatever Pinocchio and the readers of meshes would do."""

import os

import pytest

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
        ("revolute", "floating", r"arm\.urdf:4: joint 'a1' is floating; expected revolute, prismatic or fixed"),
        ('"0.04"', '"-0.04"', r"arm\.urdf:2: link 'base' has a sphere of radius -0.04; expected a positive radius"),
        ('"0.04"', '"nan"', r"arm\.urdf:2: sphere with radius 'nan'; expected finite numbers"),
        (SPHERE, '<box size="1 0 1"/>', r"arm\.urdf:2: link 'base' has a box of size 1 0 1"),
        ("<robot", "<!DOCTYPE r [<!ENTITY a 'b'>]><robot", r"arm\.urdf:1: a declaration"),
        ("<robot", "<boat/><robot", r"arm\.urdf:1: cannot be read as URDF"),
        (TEXT, "<boat/>", r"arm\.urdf:1: cannot be read as URDF: <boat>; expected <robot>"),
        (SPHERE, 40 * "<a>" + 40 * "</a>", r"arm\.urdf:2: more than 32 levels"),
        ("</robot>", "".join(f'<link name="l{k}"/>' for k in range(60_000)) + "</robot>", r"60002 links; expected at"),
        (SPHERE, MESH.replace("m.dae", "gone.stl"), r"arm\.urdf:2: mesh gone\.stl is in none of the folders above"),
    ],
)
def test_a_robot_that_cannot_be(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        robot(tmp_path, old, new)


def test_a_joint_that_mimics_another_is_told(tmp_path):
    with pytest.warns(UserWarning, match=r"arm\.urdf:5: joint 'a1' mimics 'a0'; taken as a joint of its own"):
        robot(tmp_path, LIMIT, LIMIT + '<mimic joint="a0"/>')


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
