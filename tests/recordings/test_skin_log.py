"""Logs of the skin port: rows written by hand; what cannot be read is skipped and named."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.formats.yarp import read_touches
from pps_vision.recordings.recording import Touch
from pps_vision.recordings.warnings import Problem, ProblemKind

ONE = "((12 3 4 2) (0.06 -0.029 0.00005) (-0.46 0.0 -0.0) (0.0 0.0 0.0) (0.06 -0.029 0.009) (1.0 0.0 0.0) (4 0 9) 9.3)"
OTHER = "((13 1 2 7) (0.08 0.1 0.0) (-3.6 -0.0 -0.0) (0.0 0.0 0.0) (0.08 0.1 0.0) (1.0 0.0 0.0) (1) 73.328253)"
ROWS = ["7 1412842922.482190 ", f"8 1412842922.502190 {ONE}", f"9 1412842922.522190 {ONE} {OTHER}"]
FOREARM = {"left_forearm": (3, 15, -1, 3, 0)}


def log_of(tmp_path: Path, rows: list[str]) -> Path:
    log = tmp_path / "data.log"
    log.write_text("".join(f"{row}\n" for row in rows))
    return log


@pytest.mark.parametrize(
    ("mapping", "touched"),
    [
        (FOREARM, ("left_forearm:0", "left_forearm:3")),  # physical taxels 4 and 0; 9 is past the mapping
        ({"left_forearm": (3, 15, -1, 3, 3)}, ("left_forearm:3",)),
        ({"left_forearm": (-1, 0, 0, 0, 27)}, ("left_forearm:27",)),
        ({"left_palm": (3,)}, ()),
    ],
)
def test_contacts_become_touches_of_virtual_taxels(tmp_path, mapping, touched):
    """A row without a contact touches nothing; the torso (skin part 7) has no taxels here."""
    problems: list[Problem] = []
    touches = read_touches(log_of(tmp_path, ROWS), mapping, problems)
    stamps = (1412842922.48219, 1412842922.50219, 1412842922.52219)
    assert touches == tuple(map(Touch, stamps, ((), touched, touched)))
    assert problems == []


@pytest.mark.parametrize(
    ("mapping", "touched"), [((3, 3, 3, 3, 15), ("left_forearm:15",)), ((3, 3, 3, 15), ())], ids=["last", "past"]
)
def test_a_physical_taxel_outside_the_mapping_is_left_out(tmp_path, mapping, touched):
    log = log_of(tmp_path, [ROWS[1].replace("(4 0 9)", "(-1 4)")])
    assert read_touches(log, {"left_forearm": mapping}, [])[0].taxel_ids == touched


@pytest.mark.parametrize(
    ("number", "part"),
    [(1, "left_palm"), (2, "left_forearm"), (4, "right_palm"), (5, "right_forearm"), (3, ""), (6, "")],
)
def test_skin_parts_have_the_numbers_of_the_robots_skin_library(tmp_path, number, part):
    """iCub's skinDynLib: hand, forearm and upper arm on the left are 1, 2 and 3, on the right 4, 5 and 6."""
    log = log_of(tmp_path, [ROWS[1].replace("12 3 4 2", f"12 3 4 {number}")])
    every = {f"{side}_{name}": (7,) for side in ("left", "right") for name in ("palm", "forearm", "upper_arm")}
    assert read_touches(log, every, [])[0].taxel_ids == ((f"{part}:7",) if part else ())


def test_names_of_virtual_taxels_need_no_mapping(tmp_path):
    log = log_of(tmp_path, ["0 1.0 left_forearm:3 left_palm:101", "1 2.0"])
    expected = (Touch(1.0, ("left_forearm:3", "left_palm:101")), Touch(2.0, ()))
    assert read_touches(log, None, []) == read_touches(log, FOREARM, []) == expected


def test_contacts_without_a_mapping_are_noted_and_none_is_read(tmp_path):
    problems: list[Problem] = []
    assert read_touches(log_of(tmp_path, ROWS), None, problems) == ()
    assert [(problem.kind, problem.line) for problem in problems] == [(ProblemKind.TOUCHES, None)]


@pytest.mark.parametrize(
    "bad",
    [
        "8",
        "eight 1.0",
        "8 later",
        "8 nan",
        f"8 1412842922.51 {ONE[:-1]}",
        f"8 1412842922.51 {ONE})",
        f"8 1412842922.51 {ONE.replace('0.009', 'x')}",
        f"8 1412842922.51 {ONE.replace('0.009', 'inf')}",
        f"8 1412842922.51 {ONE.replace('9.3)', 'nan)')}",
        f"8 1412842922.51 {ONE.replace('(0.0 0.0 0.0) ', '')}",
        f"8 1412842922.51 {ONE.replace('(12 3 4 2)', '(12 3 4)')}",
        f"8 1412842922.51 {ONE.replace('(4 0 9)', '4')}",
        f"8 1412842922.51 {ONE.replace('(4 0 9)', '(4 0.5 9)')}",
        f"8 1412842922.51 {ONE.replace('9.3', '(9.3)')}",
        f"8 1412842922.51 {ONE.replace('0.46', '(1) 0.46')}",
        "8 1412842922.51 word",
    ],
)
def test_a_row_that_cannot_be_read_is_skipped_and_named(tmp_path, bad):
    problems: list[Problem] = []
    log = log_of(tmp_path, [ROWS[0], bad, ROWS[2]])
    assert [touch.stamp_s for touch in read_touches(log, FOREARM, problems)] == [1412842922.48219, 1412842922.52219]
    assert [(problem.kind, problem.line) for problem in problems] == [(ProblemKind.ROW, 2)]
    with pytest.raises(InputError, match=r"data\.log:1: .*none of 2 rows"):
        read_touches(log_of(tmp_path, [bad, bad]), FOREARM, [])
