"""Tables of taxels: what length a normal may have, and an empty one."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.robot_file import read_robot, read_skin

ARM7 = Path(__file__).parents[1] / "arm7" / "robot.toml"
HEADER = "part,frame,taxel,x_m,y_m,z_m,nx,ny,nz\n"


@pytest.mark.parametrize(("length", "is_one"), [(0.45, False), (0.6, True), (2.0, True)])
def test_a_normal_is_about_as_long_as_one(tmp_path, length, is_one):
    robot = read_robot(ARM7).robot
    file = tmp_path / "skin.csv"
    file.write_text(f"{HEADER}forearm,forearm,3,0.1,0.2,0.3,0,{-length},0\n")
    if is_one:
        np.testing.assert_allclose(read_skin([file], robot).parts[0].normals, [[0, -1, 0]])
    else:
        with pytest.raises(InputError, match=r"skin\.csv:2: normal .*; expected one of length 1"):
            read_skin([file], robot)


def test_a_table_without_taxels_is_refused(tmp_path):
    (tmp_path / "skin.csv").write_text(HEADER)
    with pytest.raises(InputError, match=r"skin\.csv: no taxel; expected taxels, those of a part in one frame"):
        read_skin([tmp_path / "skin.csv"], read_robot(ARM7).robot)


def test_a_representative_beyond_the_physical_taxels_is_left_out(tmp_path):
    rows = "0.1 0.2 0.3 0 0 1\n" * 2
    (tmp_path / "part.txt").write_text(f"name forearm\ntaxel2Repr (1 2)\n[calibration]\n{rows}")
    assert read_skin([tmp_path / "part.txt"], read_robot(ARM7).robot).parts[0].ids == (1,)
