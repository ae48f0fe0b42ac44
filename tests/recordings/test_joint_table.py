"""Offsets of encoders: written and read again; every wrong line is named."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.joint_table import read_joint_offsets, write_joint_offsets

JOINTS = ("neck_pitch", "eyes_tilt", "left_elbow")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    offsets = np.array([0.01, 0.0, -0.02])
    write_joint_offsets(tmp_path / "joints.csv", JOINTS, offsets)
    np.testing.assert_allclose(read_joint_offsets(tmp_path / "joints.csv", JOINTS), offsets, rtol=1e-12)


def test_joints_without_a_line_are_right(tmp_path: Path) -> None:
    (tmp_path / "joints.csv").write_text("joint,offset_deg\n\nleft_elbow, 90\n")
    np.testing.assert_allclose(read_joint_offsets(tmp_path / "joints.csv", JOINTS), [0, 0, np.pi / 2])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "joints.csv:1: header ''; expected joint,offset_deg"),
        ("joint,degrees\n", "joints.csv:1: header 'joint,degrees'"),
        ("joint,offset_deg\nknee,1\n", "joints.csv:2: joint 'knee'; expected one of neck_pitch"),
        ("joint,offset_deg\nleft_elbow\n", "joints.csv:2: left_elbow ''; expected an offset"),
        ("joint,offset_deg\nleft_elbow,nan\n", "joints.csv:2: left_elbow 'nan'"),
        ("joint,offset_deg\nleft_elbow,inf\n", "joints.csv:2: left_elbow 'inf'"),
        ("joint,offset_deg\nleft_elbow,1 deg\n", "joints.csv:2: left_elbow '1 deg'"),
        ("joint,offset_deg\nleft_elbow,1\nleft_elbow,2\n", "joints.csv:3: left_elbow again"),
        ("\x00", "joints.csv"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "joints.csv").write_text(text)
    with pytest.raises(InputError) as refusal:
        read_joint_offsets(tmp_path / "joints.csv", JOINTS)
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_table_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.csv: cannot be read"):
        read_joint_offsets(tmp_path / "gone.csv", JOINTS)
