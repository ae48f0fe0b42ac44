"""Lists of numbers in YARP's text form."""

import pytest

from pps_vision.recordings.yarp_text import parse_lists, parse_numbers


def test_a_list_of_numbers_holds_no_list() -> None:
    assert parse_numbers(parse_lists("1 2 3"), int) == (1, 2, 3)
    for count in (None, 2, 3):
        with pytest.raises(ValueError, match="a list in a list of numbers"):
            parse_numbers(parse_lists("1 (2) 3"), int, count)
