"""One log: the rows that can be read, in order, and every other one named."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.recordings.yarp_text import read_log


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
    ("stamps", "skipped"),
    [
        ((1, 2, 3, 1.5, 4), [4]),  # a single one goes back
        ((1, 2, 3, 2.5, 4), [4]),  # of two that contradict each other, the later
        ((1, 2, 900, 3, 4, 5), [3]),  # one that jumps ahead does not discard what follows
        ((1, 2, 2, 3), []),  # equal stamps happen in real joint logs
        ((5, 6, 7, 1, 2), [4, 5]),  # the clock was set back: the longer part
    ],
)
def test_stamps_that_go_backwards_are_skipped(log, stamps, skipped):
    rows, problems = read(log, "".join(f"0 {stamp} a.ppm\n" for stamp in stamps), None)
    assert problems == [(ProblemKind.STAMP, line) for line in skipped]
    assert [line for line, _ in rows] == [line for line in range(1, len(stamps) + 1) if line not in skipped]


@pytest.mark.parametrize(
    ("stamps", "skipped"),
    [
        ((1, 2, 2, 3), [3]),  # the first of two that are equal stays
        ((1, 1, 1), [2, 3]),
        ((1, 2, 900, 3, 3, 4), [3, 5]),
        ((1, 2, 3, 2, 4), [4]),
    ],
)
def test_stamps_that_must_differ(log, stamps, skipped):
    rows, problems = read(log, "".join(f"0 {stamp} a.ppm\n" for stamp in stamps), None, distinct_stamps=True)
    assert problems == [(ProblemKind.STAMP, line) for line in skipped]
    assert [line for line, _ in rows] == [line for line in range(1, len(stamps) + 1) if line not in skipped]


def test_a_log_of_which_nothing_can_be_read_is_refused(log):
    with pytest.raises(InputError, match=r"data\.log:2: 'what is this'; expected .* none of 2 rows can be read"):
        read(log, "\nwhat is this\nor that\n", 3)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_log(log.with_name("none.log"), None, [])
