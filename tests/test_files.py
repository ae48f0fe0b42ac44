"""Files that are read: only regular ones, and every refusal in one line."""

import os
from pathlib import Path

import pytest

from pps_vision.errors import InputError, cite
from pps_vision.files import check_regular, read_bytes


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
    assert str(InputError("a\nb", "odd", 3)) == "a b:3: odd"
    just = "x" * 300 + "y" * 300
    assert cite("a", None, just) == f"a: {just}"
    assert cite("a", None, f"{just}z") == f"a: {'x' * 300} … {'y' * 299}z"
