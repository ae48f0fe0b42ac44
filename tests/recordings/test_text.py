"""What counts as a number in a text file, and what as a file."""

import pytest

from pps_vision.recordings.text import finite, first_row, number, read_lines, whole


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
