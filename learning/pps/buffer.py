"""Buffer of the last three seconds of D and TTC, resampled back in 50 ms steps (R, "Data collection")."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, TaxelEvents


@dataclass(frozen=True)
class BufferParams:
    """Length and resampling of the buffer."""

    length_s: float = 3.0
    """How far back the buffer reaches (R)."""
    step_s: float = 0.05
    """Time step of the resampled series (R)."""
    max_gap_s: float = 0.15
    """Longest gap that is interpolated: three steps, our choice."""


@dataclass(frozen=True)
class EventBuffer:
    """Samples in order of time."""

    params: BufferParams = field(default_factory=BufferParams)
    """Length and resampling."""
    samples: tuple[TaxelEvents, ...] = ()
    """All samples of the last `length_s`, oldest first."""


def push(buffer: EventBuffer, events: TaxelEvents) -> EventBuffer:
    """The buffer with one more sample; ValueError for a stamp that does not advance."""
    samples = buffer.samples
    if samples and events.stamp_s <= samples[-1].stamp_s:
        raise ValueError(f"stamp {events.stamp_s} s after {samples[-1].stamp_s} s: expected a later one")
    if samples and events.taxel_ids != samples[-1].taxel_ids:
        raise ValueError(f"a sample of {len(events.taxel_ids)} taxels: expected the buffer's own taxels")
    oldest = events.stamp_s - buffer.params.length_s
    kept = tuple(sample for sample in samples if sample.stamp_s >= oldest)
    return replace(buffer, samples=(*kept, events))


def resample(buffer: EventBuffer) -> tuple[Array, Array]:
    """D and TTC (T, n) at `step_s` back from the last sample, oldest first.

    Interpolated between two samples that both lie in a taxel's receptive field and approach
    (D and TTC finite) and are at most `max_gap_s` apart; NaN otherwise.
    """
    if not buffer.samples:
        return np.empty((0, 0)), np.empty((0, 0))
    n = len(buffer.samples[0].taxel_ids)
    seen, *resampled = resample_seen(buffer, np.arange(n))
    D, TTC = np.full((2, len(resampled[0]), n), np.nan)
    D[:, seen], TTC[:, seen] = resampled
    return D, TTC


def resample_seen(buffer: EventBuffer, taxels: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array]:
    """Those k of the `taxels` that have a sample, and D and TTC (T, k) as `resample`; ValueError without samples.

    Few of a whole skin's taxels perceive one stimulus: time and memory are those of the few.
    """
    params, samples = buffer.params, buffer.samples
    if not samples:
        raise ValueError("a buffer without samples; expected at least one")
    stamps = np.array([sample.stamp_s for sample in samples])
    known = np.array([np.isfinite(s.distance_m[taxels]) & np.isfinite(s.ttc_s[taxels]) for s in samples])
    at = np.flatnonzero(known.any(axis=0))
    seen = taxels[at]
    series = np.array([[s.distance_m[seen], s.ttc_s[seen]] for s in samples], dtype=float)  # (samples, 2, k)
    series[~np.broadcast_to(known[:, None, at], series.shape)] = np.nan
    back = np.arange(int((stamps[-1] - stamps[0]) / params.step_s + 1e-6), -1, -1)
    times = stamps[-1] - back * params.step_s
    after = np.clip(np.searchsorted(stamps, times), min(1, len(stamps) - 1), len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    span = stamps[after] - stamps[before]
    weight = np.where(span > 0, (times - stamps[before]) / np.where(span > 0, span, 1.0), 1.0)
    on_before, on_after = weight < 1e-6, weight > 1 - 1e-6  # on a sample its neighbour's NaN must not spread
    w = weight[:, None, None]
    grid = (1 - w) * series[before] + w * series[after]
    grid[span > params.max_gap_s] = np.nan
    grid[on_before], grid[on_after] = series[before][on_before], series[after][on_after]
    return seen, grid[:, 0], grid[:, 1]
