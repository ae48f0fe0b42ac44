"""Buffer of the last three seconds of D and TTC, resampled back in 50 ms steps (R, "Data collection")."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, TaxelEvents

LENGTH_S = 3.0
"""How far back the buffer reaches (R)."""
STEP_S = 0.05
"""Time step of the resampled series (R)."""
_MAX_GAP_S = 0.15  # longest gap that is interpolated: three steps, our choice


@dataclass(frozen=True)
class EventBuffer:
    """Samples in order of time."""

    samples: tuple[TaxelEvents, ...] = ()
    """All samples of the last `LENGTH_S`, oldest first."""


def push(buffer: EventBuffer, events: TaxelEvents) -> EventBuffer:
    """The buffer with one more sample; ValueError for a stamp that does not advance."""
    samples = buffer.samples
    if samples and events.stamp_s <= samples[-1].stamp_s:
        raise ValueError(f"stamp {events.stamp_s} s after {samples[-1].stamp_s} s: expected a later one")
    if samples and events.taxel_ids != samples[-1].taxel_ids:
        raise ValueError(f"a sample of {len(events.taxel_ids)} taxels: expected the buffer's own taxels")
    oldest = events.stamp_s - LENGTH_S
    kept = tuple(sample for sample in samples if sample.stamp_s >= oldest)
    return EventBuffer((*kept, events))


def resample(buffer: EventBuffer, taxels: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array]:
    """Those k of the `taxels` that have a sample, and their D and TTC (T, k) at `STEP_S` back from the last sample,
    oldest first; ValueError without samples.

    Interpolated between two samples that both lie in a taxel's receptive field and approach (D and TTC finite) and are
    at most `_MAX_GAP_S` apart; NaN otherwise.  Few of a whole skin's taxels perceive one stimulus: time and memory are
    those of the few.
    """
    samples = buffer.samples
    if not samples:
        raise ValueError("a buffer without samples; expected at least one")
    stamps = np.array([sample.stamp_s for sample in samples])
    known = np.array([np.isfinite(s.distance_m[taxels]) & np.isfinite(s.ttc_s[taxels]) for s in samples])
    at = np.flatnonzero(known.any(axis=0))
    seen = taxels[at]
    series = np.array([[s.distance_m[seen], s.ttc_s[seen]] for s in samples], dtype=float)  # (samples, 2, k)
    series[~np.broadcast_to(known[:, None, at], series.shape)] = np.nan
    back = np.arange(int((stamps[-1] - stamps[0]) / STEP_S + 1e-6), -1, -1)
    times = stamps[-1] - back * STEP_S
    after = np.searchsorted(stamps, times)
    before = np.maximum(after - 1, 0)
    span = stamps[after] - stamps[before]
    weight = np.divide(times - stamps[before], span, out=np.ones_like(span), where=span > 0)
    on_before, on_after = weight < 1e-6, weight > 1 - 1e-6  # on a sample its neighbour's NaN must not spread
    w = weight[:, None, None]
    grid = (1 - w) * series[before] + w * series[after]
    grid[span > _MAX_GAP_S] = np.nan
    grid[on_before], grid[on_after] = series[before][on_before], series[after][on_after]
    return seen, grid[:, 0], grid[:, 1]
