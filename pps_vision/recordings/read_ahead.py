"""Reading the next items beside the work on one."""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")
_END: Any = object()


def read_ahead(items: Iterable[T], n: int) -> Iterator[T]:
    """Yield all items in order, while another thread reads up to `n` of the next ones."""
    source = iter(items)
    with ThreadPoolExecutor(1, "read ahead") as thread:
        waiting = deque(thread.submit(next, source, _END) for _ in range(n))
        try:
            while (item := waiting.popleft().result()) is not _END:
                waiting.append(thread.submit(next, source, _END))
                yield item
        finally:
            for reading in waiting:
                reading.cancel()
