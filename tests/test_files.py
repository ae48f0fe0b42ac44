"""Files that are read: only regular ones, every refusal in one line, problems, numbers and lines of text."""

import copy
import os
from pathlib import Path

import pytest

from pps_vision.errors import InputError, cite, first_line
from pps_vision.files import check_regular, read_bytes
from pps_vision.recordings.text import finite, first_row, number, read_lines, whole
from pps_vision.recordings.warnings import Problem, ProblemKind, count_by_kind


def test_only_a_regular_file_is_read(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    assert read_bytes(tmp_path / "file", "a table") == b"content"
    os.mkfifo(tmp_path / "pipe")
    for name, problem in (
        ("gone", "cannot be read: No such file or directory"),
        (".", "is a folder"),
        ("pipe", "is a device, pipe or socket"),
        ("zero\0byte", "cannot be read: embedded null byte"),
    ):
        for read in (check_regular, read_bytes):
            with pytest.raises(InputError) as refused:
                read(tmp_path / name, "a table")
            assert str(refused.value) == f"{tmp_path / name}: {problem}; expected a table"


def test_a_message_is_one_line_and_a_long_one_has_its_beginning_and_its_end():
    assert cite("a.csv", None, "two\nlines") == "a.csv: two lines"
    assert cite(Path("a.csv"), 0, "odd") == "a.csv:0: odd"
    assert str(InputError("a\nb", "odd\r\n", 3)) == "a b:3: odd"
    assert str(Problem(ProblemKind.ROW, Path("a"), 1, "two\nlines")) == "a:1: two lines"
    just = "x" * 300 + "y" * 300
    assert cite("a", None, just) == f"a: {just}"
    assert cite("a", None, f"{just}z") == f"a: {'x' * 300} … {'y' * 299}z"


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


@pytest.mark.parametrize(
    ("word", "is_number", "is_finite", "is_whole"),
    [
        ("12", True, True, True),
        ("-3", True, True, True),
        ("-0.5e-3", True, True, False),
        ("nan", True, False, False),
        ("-inf", True, False, False),
        ("1_5", False, False, False),  # a typing error, though Python reads 15
        ("٣", False, False, False),  # an Arabic three
        ("+3", True, True, False),
        ("--3", False, False, False),
        ("", False, False, False),
    ],
)
def test_what_is_a_number(word, is_number, is_finite, is_whole):
    for read, is_one in ((number, is_number), (finite, is_finite), (whole, is_whole)):
        if is_one:
            assert read(word) == pytest.approx(float(word), nan_ok=True)
        else:
            with pytest.raises(ValueError, match=r".+"):
                read(word)


def test_lines_are_without_their_mark_and_with_signs_for_what_is_no_text(tmp_path):
    file = tmp_path / "a.txt"
    file.write_bytes(b"\xef\xbb\xbf one \n\xff\n")
    assert read_lines(file, "rows") == [" one ", "\ufffd", ""]
    assert first_row(file) == "one"
    file.write_bytes(b"1" * 10_001 + b"\n")
    assert first_row(file) == "1" * 10_000
    assert first_row(tmp_path) == first_row(tmp_path / "gone") == ""
