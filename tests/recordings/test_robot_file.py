"""A robot.toml whose cameras turn, and one without skin."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.robot_file import read_robot

ARM7 = Path(__file__).parents[1] / "arm7" / "robot.toml"
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


def test_without_skin_there_is_no_robot(tmp_path):
    file = written(tmp_path, "")
    file.write_text(file.read_text().replace(f'skin = "{ARM7.with_name("skin.csv")}"', "skin = []"))
    with pytest.raises(InputError, match="skin: no taxel; expected taxels, those of a part in one frame"):
        read_robot(file)
