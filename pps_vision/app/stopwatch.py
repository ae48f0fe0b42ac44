"""How long each stage takes."""

import time
from array import array
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from pps_vision.app.results import StageTimes


class Stopwatch:
    """Collects milliseconds by stage: `with stopwatch("trigger"): …`."""

    def __init__(self) -> None:
        self.ms: dict[str, array[float]] = defaultdict(lambda: array("d"))  # 8 bytes a run

    @contextmanager
    def __call__(self, stage: str, runs: int = 1) -> Iterator[None]:
        """Time the enclosed block as `runs` equal runs of `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.ms[stage].extend([1000 * (time.perf_counter() - start) / runs] * runs)

    def summary(self) -> dict[str, StageTimes]:
        """Median and quartiles of ms, and the number of runs, of every stage."""
        summary: dict[str, StageTimes] = {}
        for stage, ms in self.ms.items():
            q25_ms, median_ms, q75_ms = map(float, np.percentile(ms, (25, 50, 75)))
            summary[stage] = {"q25_ms": q25_ms, "median_ms": median_ms, "q75_ms": q75_ms, "runs": len(ms)}
        return summary
