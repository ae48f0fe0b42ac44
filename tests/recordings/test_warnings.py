"""How bad input is worded and counted."""

import copy
from pathlib import Path

import pytest

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.warnings import Problem, ProblemKind, count_by_kind


def test_a_message_stays_one_line_whatever_it_quotes():
    assert str(InputError("a\nb", "two\nlines\r\n")).splitlines() == ["a b: two lines"]
    assert str(Problem(ProblemKind.ROW, Path("a"), 1, "two\nlines")) == "a:1: two lines"


def test_a_fatal_error_survives_copying_as_worker_processes_need():
    assert str(copy.copy(InputError("a", "b", 2))) == "a:2: b"


def test_counts_name_every_kind():
    problems = [Problem(kind, Path("a"), 1, "x") for kind in (ProblemKind.IMAGE, ProblemKind.IMAGE, ProblemKind.JOINTS)]
    counts = {"bad_image": 2, "bad_row": 0, "backwards_stamp": 0, "bad_joints": 1}
    counts |= {"unpaired_frame": 0, "unknown_touches": 0}
    assert count_by_kind(problems) == counts


def test_the_systems_words_for_a_missing_file():
    with pytest.raises(OSError, match="nowhere") as caught:
        Path("/nowhere/at/all").read_text()
    assert first_line(caught.value) == "No such file or directory"
    assert first_line(ValueError("two\nlines")) == "two lines"
