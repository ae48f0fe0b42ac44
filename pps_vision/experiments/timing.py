"""Processor times of calls; other work disturbs them less than times by the clock."""

from collections.abc import Callable, Iterable
from functools import partial
from time import process_time
from typing import TypeVar

F = TypeVar("F")
T = TypeVar("T")


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a call and its processor time (ms)."""
    begun = process_time()
    result = call()
    return result, 1000 * (process_time() - begun)


def timed_steps(step: Callable[[F], T], frames: Iterable[F]) -> tuple[list[T], list[float]]:
    """Return the results of a step on every frame and their processor times (ms)."""
    pairs = [timed(partial(step, frame)) for frame in frames]
    return [result for result, _ in pairs], [ms for _, ms in pairs]


def timed_runs(call: Callable[[], object], runs: int) -> list[float]:
    """Return the processor times (ms) of some calls; one more before them fills caches and does not count."""
    return [timed(call)[1] for _ in range(1 + runs)][1:]
