"""The robot's taxels*.ini: a file written by hand, read and written again, and every way it can be wrong."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.taxels_ini import read_taxels, write_taxels

HAND = """[l_hand]
modality\t1D
size    \t6
nTaxels \t2
ext     \t(-0.05 0.45)
binsNum \t(3\t1)
Mapping\t(-1 7 7 -1 4 4)
7 (1 2 3) (4 5 6)
4 (0 0 4000000000) (0 1 0)

[r_forearm]
modality 2D
size        3
nTaxels     1
ext         (-0.1 0.2 0.0 1.2)
binsNum     (2  3)
Mapping (0 0 -1)
0      (1 2 3 4 5 6)   (60 50 40 30 20 10)
"""


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    file = tmp_path / "taxels.ini"
    file.write_text(HAND)
    return file


def test_what_a_file_says_is_read(hand):
    palm, forearm = read_taxels(hand)
    assert (palm.name, palm.extent, palm.bins, palm.mapping) == ("l_hand", (-0.05, 0.45), (3, 1), (-1, 7, 7, -1, 4, 4))
    assert list(palm.counts) == [7, 4]
    np.testing.assert_array_equal(palm.counts[7][:, 0], [[1, 4], [2, 5], [3, 6]])
    assert palm.counts[4][2, 0, 0] == 4_000_000_000  # past 32 bits
    assert (forearm.name, forearm.extent, forearm.bins) == ("r_forearm", (-0.1, 0.2, 0.0, 1.2), (2, 3))
    np.testing.assert_array_equal(forearm.counts[0][..., 0], [[1, 2, 3], [4, 5, 6]])  # a row a distance
    np.testing.assert_array_equal(forearm.counts[0][..., 1], [[60, 50, 40], [30, 20, 10]])


def test_written_and_read_again_it_is_the_same(hand, tmp_path):
    write_taxels(tmp_path / "again.ini", read_taxels(hand))
    assert _without_white_space(tmp_path / "again.ini") == _without_white_space(hand)


def _without_white_space(file: Path) -> list[list[str]]:
    lines = file.read_text().replace("(", " ( ").replace(")", " ) ").splitlines()
    return [line.split() for line in lines if line.strip()]


@pytest.mark.parametrize(
    ("old", "new", "where", "says"),
    [
        ("modality\t1D", "modality\t3D", 2, "modality 3D; expected 1D or 2D"),
        ("size    \t6", "size    \tsix", 3, "size six; expected a whole number"),
        ("size    \t6", "size    \t7", 7, "expected 1 × (7 numbers), found 6 numbers"),
        ("nTaxels \t2", "nTaxels \t3", 4, "nTaxels 3; expected 2, as many taxels as follow"),
        ("(-0.05 0.45)", "(-0.05)", 5, "ext (-0.05); expected 1 × (2 numbers), found 1 numbers"),
        ("(-0.05 0.45)", "(0.45 -0.05)", 5, "expected ranges from low to high"),
        ("(-0.05 0.45)", "(-0.05 nan)", 5, "ext (-0.05 nan); expected 1 × (2 numbers), found 'nan' is not finite"),
        ("(-0.05 0.45)", "-0.05 0.45", 5, "ext -0.05 0.45; expected 1 × (2 numbers)"),
        ("(3\t1)", "(3\t2)", 6, "in 1D one of TTC"),
        ("(3\t1)", "(0\t1)", 6, "binsNum (0 1); expected bins"),
        ("7 (1 2 3)", "7 (1 2 3 4)", 8, "7 (1 2 3 4) (4 5 6); expected 2 × (3 numbers), found 4 numbers"),
        ("7 (1 2 3)", "7 (1 2 x)", 8, "found 'x' is no whole number"),
        ("7 (1 2 3)", "7 (1 2 3.5)", 8, "found '3.5' is no whole number"),
        ("7 (1 2 3)", "7 (1 -2 3)", 8, "expected counts from 0"),
        ("7 (1 2 3)", "7 (1 99999999999999999999 3)", 8, "expected counts from 0 to 2^53"),
        ("7 (1 2 3)", "7 (1 9007199254740993 3)", 8, "expected counts from 0 to 2^53"),
        ("7 (1 2 3)", "1234567890 (1 2 3)", 8, "and the numbers of taxels"),
        ("(-0.05 0.45)", "(0.45 0.45)", 5, "expected ranges from low to high"),
        ("0.0 1.2", "1.2 0.0", 15, "expected ranges from low to high"),
        ("7 (1 2 3) (4 5 6)", "7 (1 2 3)", 8, "expected 2 × (3 numbers), found 1 lists"),
        ("7 (1 2 3)", "4 (1 2 3)", 9, "4 (0 0 4000000000) (0 1 0); expected each key once in [l_hand]"),
        ("modality\t1D\n", "modality 1D\ncolour\tred\n", 3, "colour red; expected modality, size"),
        ("modality\t1D\n", "", 1, "[l_hand] has no modality"),
        ("[r_forearm]", "[l_hand]", 11, "section [l_hand]; expected each section once"),
        ("[l_hand]\n", "", 1, "modality 1D; expected a [body part]"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(hand, old, new, where, says):
    hand.write_text(HAND.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_taxels(hand)
    assert str(error.value).startswith(f"{hand}:{where}: ")
    assert says in str(error.value)


def test_no_file_and_no_section(tmp_path):
    with pytest.raises(InputError, match=r"gone\.ini: cannot be read"):
        read_taxels(tmp_path / "gone.ini")
    (tmp_path / "empty.ini").write_text("\n")
    with pytest.raises(InputError, match=r"empty\.ini: no section"):
        read_taxels(tmp_path / "empty.ini")
