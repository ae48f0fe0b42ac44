"""Skin position files: one written by hand, read and written again, and every way it can be wrong."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.skin_positions import read_skin_positions, write_skin_positions

HAND = """name    l_forearm
spatial_sampling     taxel
taxel2Repr (  1  1  -1 )
[calibration]
-0.0308\t-0.0669\t0.0235\t-0.9877\t0.0707\t0.1393
 0.000  0.000  0.000 -0.000 -0.000 -0.000
0.01 0.02 0.03 0.0 0.0 2.0

"""


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    file = tmp_path / "skin.txt"
    file.write_text(HAND)
    return file


def test_what_a_file_says_is_read_and_written_again(hand: Path, tmp_path: Path) -> None:
    skin = read_skin_positions(hand)
    write_skin_positions(tmp_path / "again.txt", skin)
    for read in (skin, read_skin_positions(tmp_path / "again.txt")):
        assert (read.name, read.spatial_sampling, read.mapping) == ("l_forearm", "taxel", (1, 1, -1))
        np.testing.assert_array_equal(read.positions_m, [[-0.0308, -0.0669, 0.0235], [0, 0, 0], [0.01, 0.02, 0.03]])
        np.testing.assert_array_equal(read.normals[0], [-0.9877, 0.0707, 0.1393])
        np.testing.assert_array_equal(read.normals[2], [0, 0, 2])  # as recorded, whatever its length
        np.testing.assert_array_equal(read.exists, [True, False, True])
        assert np.signbit(read.normals[1]).all()  # even the sign of a zero


@pytest.mark.parametrize(
    ("old", "new", "where", "says"),
    [
        ("-0.9877", "north", ":5", "expected x y z nx ny nz"),
        ("-0.9877", "", ":5", "expected x y z nx ny nz"),
        ("-0.9877", "nan", ":5", "all finite"),
        ("(  1  1  -1 )", "(  1  1 )", ":3", "taxel2Repr has 2 numbers; expected 3"),
        ("(  1  1  -1 )", "(  1  one  -1 )", ":3", "expected whole numbers"),
        ("name    l_forearm\n", "", "", "no name"),
        ("[calibration]\n", "", ":4", "[calibration]"),
        ("spatial_sampling", "name", ":2", "'name     taxel'; expected each"),
        ("taxel2Repr", "taxel3Repr", ":3", "'taxel3Repr"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(hand: Path, old: str, new: str, where: str, says: str) -> None:
    hand.write_text(HAND.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_skin_positions(hand)
    assert str(error.value).startswith(f"{hand}{where}: ")
    assert says in str(error.value)


def test_no_file_and_no_rows(hand: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.txt: cannot be read"):
        read_skin_positions(tmp_path / "gone.txt")
    hand.write_text("\n".join(HAND.splitlines()[:4]))
    with pytest.raises(InputError, match="rows after"):
        read_skin_positions(hand)


def test_a_taxel_at_the_frames_origin_exists(hand: Path) -> None:
    hand.write_text(HAND.replace(" 0.000  0.000  0.000 -0.000 -0.000 -0.000", "0 0 0 0 0 1"))
    assert read_skin_positions(hand).exists.all()
