"""Buffer of the last three seconds of D and TTC, resampled back in 50 ms steps (R, "Data collection")."""

from dataclasses import dataclass, field, replace

import numpy as np

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
    params, samples = buffer.params, buffer.samples
    if not samples:
        return np.empty((0, 0)), np.empty((0, 0))
    stamps = np.array([sample.stamp_s for sample in samples])
    series = np.array([[s.distance_m, s.ttc_s] for s in samples], dtype=float)  # (samples, 2, n)
    known = np.isfinite(series).all(axis=1)
    seen = np.flatnonzero(known.any(axis=0))  # few of a whole skin's taxels perceive one stimulus: saves time
    series = np.where(known[:, None, seen], series[:, :, seen], np.nan)
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
    D, TTC = np.full((2, len(times), len(samples[0].taxel_ids)), np.nan)
    D[:, seen], TTC[:, seen] = grid[:, 0], grid[:, 1]
    return D, TTC
