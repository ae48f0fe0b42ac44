"""Processor times of calls; other work disturbs them less than times by the clock."""

import resource
from collections.abc import Callable, Iterable
from functools import partial
from time import process_time
from typing import TypeVar

import numpy as np

F = TypeVar("F")
T = TypeVar("T")


def processor_s() -> float:
    """Return the processor time (s) of this process and its finished children."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


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


def quartiles(ms: Iterable[float]) -> list[float]:
    """Return the median and the lower and upper quartile."""
    return [round(float(q), 5) for q in np.percentile(list(ms), (50, 25, 75))]
