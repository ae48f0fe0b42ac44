"""Logs of ports, of the skin's above all: rows written by hand; what cannot be read is skipped and named."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.formats.yarp import read_touches
from pps_vision.recordings.recording import Touch
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.recordings.yarp_text import read_log

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
    [
        (1, "left_palm"),
        (2, "left_forearm"),
        (4, "right_palm"),
        (5, "right_forearm"),
        (3, "left_upper_arm"),
        (6, "right_upper_arm"),
        (8, ""),
    ],
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


def read(
    log: Path, text: str, n_numbers: int | None, **kwargs: bool
) -> tuple[list[tuple[int, float]], list[tuple[ProblemKind, int]]]:
    """(line, stamp) of each row read and (kind, line) of each problem."""
    log.write_text(text)
    problems: list[Problem] = []
    rows = read_log(log, n_numbers, problems, **kwargs)
    return [(row.line, row.stamp_s) for row in rows], [(problem.kind, problem.line) for problem in problems]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "data.log"


def test_an_empty_payload_and_blank_lines_are_no_problem(log):
    assert read(log, "\n0 1.5 \r\n\n1 2.5\n", None) == ([(2, 1.5), (4, 2.5)], [])
    assert read(log, "", 3) == ([], [])


@pytest.mark.parametrize(
    "row", ["1 2.0 7", "1 2.0 2.1 2.2 7 8", "x 2.0 7 8", "1 nan 7 8", "1 2.0 7 eight", "1 9e99 7 8", "1 1.2e12 7 8"]
)
def test_a_row_of_another_form_is_skipped(log, row):
    rows, problems = read(log, f"0 1.0 7 8\n{row}\n2 3.0 7 8\n", 2)
    assert [line for line, _ in rows] == [1, 3]
    assert problems == [(ProblemKind.ROW, 2)]


@pytest.mark.parametrize(
    ("stamps", "skipped", "distinct"),
    [
        ((1, 2, 3, 1.5, 4), [4], False),  # a single one goes back
        ((1, 2, 3, 2.5, 4), [4], False),  # of two that contradict each other, the later
        ((1, 2, 900, 3, 4, 5), [3], False),  # one that jumps ahead does not discard what follows
        ((1, 2, 2, 3), [], False),  # equal stamps happen in real joint logs
        ((5, 6, 7, 1, 2), [4, 5], False),  # the clock was set back: the longer part
        ((1, 2, 2, 3), [3], True),  # the first of two that are equal stays
        ((1, 1, 1), [2, 3], True),
        ((1, 2, 900, 3, 3, 4), [3, 5], True),
        ((1, 2, 3, 2, 4), [4], True),
    ],
)
def test_stamps_that_go_backwards_or_must_differ_are_skipped(log, stamps, skipped, distinct):
    rows, problems = read(log, "".join(f"0 {stamp} a.ppm\n" for stamp in stamps), None, distinct_stamps=distinct)
    assert problems == [(ProblemKind.STAMP, line) for line in skipped]
    assert [line for line, _ in rows] == [line for line in range(1, len(stamps) + 1) if line not in skipped]


def test_a_log_of_which_nothing_can_be_read_is_refused(log):
    with pytest.raises(InputError, match=r"data\.log:2: 'what is this'; expected .* none of 2 rows can be read"):
        read(log, "\nwhat is this\nor that\n", 3)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_log(log.with_name("none.log"), None, [])
