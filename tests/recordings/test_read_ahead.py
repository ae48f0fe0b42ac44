"""Items that another thread reads ahead."""

import threading
from collections.abc import Iterator

import pytest

from pps_vision.recordings.read_ahead import read_ahead


def test_all_items_come_in_order_and_only_a_few_are_read_ahead():
    read = []

    def items() -> Iterator[int]:
        for k in range(50):
            read.append((k, threading.current_thread()))
            yield k

    for expected, k in enumerate(read_ahead(items(), 3)):
        assert k == expected
        assert len(read) <= k + 1 + 3
    assert len(read) == 50
    assert {thread for _, thread in read}.isdisjoint({threading.main_thread()})


def test_an_error_comes_after_the_items_before_it():
    def items() -> Iterator[int]:
        yield from (0, 1)
        raise OSError("gone")

    source = read_ahead(items(), 3)
    assert [next(source), next(source)] == [0, 1]
    with pytest.raises(OSError, match="gone"):
        next(source)


def test_nothing_is_read_any_more_after_the_reader_stops():
    read = []
    source = read_ahead((read.append(k) or k for k in range(50)), 2)
    next(source)
    source.close()
    assert len(read) <= 4
    assert not any(thread.name.startswith("read ahead") for thread in threading.enumerate())
