"""A robot.toml whose cameras turn, one without skin, and tables of taxels."""

from pathlib import Path

import numpy as np
import pytest
from data import ARM7

from pps_vision.errors import InputError
from pps_vision.recordings.robot_file import read_robot, read_skin

GAZE = 'gaze_joints = ["a1", "a2", "a3", "a4", "a5"]\n'
PORTS = '[ports]\nhead = ["a1", "-", "version", "vergence"]\n'


def written(folder: Path, more: str, ports: str = "") -> Path:
    """The arm's file with more keys."""
    text = ARM7.read_text().replace("[home_deg]", f"{more}\n{ports}\n[home_deg]")
    for name in ("arm.urdf", "skin.csv"):
        text = text.replace(f'"{name}"', f'"{ARM7.with_name(name)}"')
    (folder / "robot.toml").write_text(text)
    return folder / "robot.toml"


def test_eyes_that_turn_have_five_joints_and_may_be_read_as_version_and_vergence(tmp_path):
    setup = read_robot(written(tmp_path, GAZE, PORTS))
    assert setup.robot.names.gaze_joints == ("a1", "a2", "a3", "a4", "a5")
    assert setup.ports == {"head": ("a1", "-", "version", "vergence")}
    with pytest.raises(InputError, match="unknown 'version' in port head; expected joints of a1, a2"):
        read_robot(written(tmp_path, "", PORTS))
    with pytest.raises(InputError, match=r"gaze_joints .*; expected neck yaw, neck pitch, eyes tilt"):
        read_robot(written(tmp_path, GAZE.replace('["a1", ', "[")))


def test_a_palm_without_an_arm_is_refused(tmp_path):
    with pytest.raises(InputError, match="left_palm 'palm'; expected both left_arm and left_palm, or neither"):
        read_robot(written(tmp_path, 'left_palm = "palm"'))


def test_a_joint_that_follows_another_is_no_joint_of_an_arm(tmp_path):
    file = written(tmp_path, "")
    text = ARM7.with_name("arm.urdf").read_text()
    joint = text[text.index('<joint name="a7"') :].partition("</joint>")[0]
    (tmp_path / "mimic.urdf").write_text(text.replace(joint, joint + '<mimic joint="a6"/>'))
    with pytest.raises(InputError, match=r"robot\.toml:7: unknown 'a7' in right_arm; expected some of a1, .*, a6$"):
        read_robot(file, urdf=tmp_path / "mimic.urdf")


def test_without_skin_there_is_no_robot(tmp_path):
    file = written(tmp_path, "")
    file.write_text(file.read_text().replace(f'skin = "{ARM7.with_name("skin.csv")}"', "skin = []"))
    with pytest.raises(InputError, match="skin: no taxel; expected taxels, those of a part in one frame"):
        read_robot(file)


@pytest.mark.parametrize(("length", "is_one"), [(0.45, False), (0.6, True), (2.0, True)])
def test_a_normal_is_about_as_long_as_one(tmp_path, length, is_one):
    robot = read_robot(ARM7).robot
    file = tmp_path / "skin.csv"
    file.write_text(f"part,frame,taxel,x_m,y_m,z_m,nx,ny,nz\nforearm,forearm,3,0.1,0.2,0.3,0,{-length},0\n")
    if is_one:
        np.testing.assert_allclose(read_skin([file], robot).parts[0].normals, [[0, -1, 0]])
    else:
        with pytest.raises(InputError, match=r"skin\.csv:2: normal .*; expected one of length 1"):
            read_skin([file], robot)


def test_a_representative_beyond_the_physical_taxels_is_left_out(tmp_path):
    rows = "0.1 0.2 0.3 0 0 1\n" * 2
    (tmp_path / "part.txt").write_text(f"name forearm\ntaxel2Repr (1 2)\n[calibration]\n{rows}")
    assert read_skin([tmp_path / "part.txt"], read_robot(ARM7).robot).parts[0].ids == (1,)
