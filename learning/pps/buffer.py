"""Buffer of the last three seconds of D and TTC, resampled back in 50 ms steps (R, "Data collection")."""

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, TaxelEvents

LENGTH_S = 3.0  # how far back the buffer reaches (R)
STEP_S = 0.05  # time step of the resampled series (R)
_MAX_GAP_S = 0.15  # longest gap that is interpolated: three steps, our choice
EventBuffer = tuple[TaxelEvents, ...]  # all samples of the last `LENGTH_S`, oldest first


def push(buffer: EventBuffer, events: TaxelEvents) -> EventBuffer:
    """The buffer with one more sample; ValueError for a stamp that does not advance."""
    if buffer and events.stamp_s <= buffer[-1].stamp_s:
        raise ValueError(f"stamp {events.stamp_s} s after {buffer[-1].stamp_s} s: expected a later one")
    if buffer and events.taxel_ids != buffer[-1].taxel_ids:
        raise ValueError(f"a sample of {len(events.taxel_ids)} taxels: expected the buffer's own taxels")
    oldest_s = events.stamp_s - LENGTH_S
    return (*(sample for sample in buffer if sample.stamp_s >= oldest_s), events)


def resample(buffer: EventBuffer, taxels: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """The k `taxels` that perceived a stimulus, and their D, TTC and predicted miss distance (T, k) in steps of
    `STEP_S` back from the last sample, oldest first; ValueError without samples.

    Interpolated between two samples that both lie in a taxel's receptive field and approach (D and TTC finite) and are
    at most `_MAX_GAP_S` apart; NaN otherwise.  Of a whole skin few taxels perceive a stimulus; only they cost time.
    """
    if not buffer:
        raise ValueError("a buffer without samples; expected at least one")
    stamps = np.array([sample.stamp_s for sample in buffer])
    perceived = np.array([np.isfinite(s.distance_m[taxels]) & np.isfinite(s.ttc_s[taxels]) for s in buffer])
    columns = np.flatnonzero(perceived.any(axis=0))
    perceiving = taxels[columns]
    on_path = np.zeros(len(buffer[0].taxel_ids))  # of samples without a predicted miss distance
    series = np.array(
        [[a[perceiving] for a in (s.distance_m, s.ttc_s, on_path if s.miss_m is None else s.miss_m)] for s in buffer],
        dtype=float,
    )
    series[~np.broadcast_to(perceived[:, None, columns], series.shape)] = np.nan  # (samples, 3, k)
    back = np.arange(int((stamps[-1] - stamps[0]) / STEP_S + 1e-6), -1, -1)
    times = stamps[-1] - back * STEP_S
    later = np.searchsorted(stamps, times)
    earlier = np.maximum(later - 1, 0)
    span = stamps[later] - stamps[earlier]
    weight = np.divide(times - stamps[earlier], span, out=np.ones_like(span), where=span > 0)
    w = weight[:, None, None]
    grid = (1 - w) * series[earlier] + w * series[later]
    grid[span > _MAX_GAP_S] = np.nan
    for sample, is_on in ((earlier, weight < 1e-6), (later, weight > 1 - 1e-6)):
        grid[is_on] = series[sample][is_on]  # on a sample, its neighbour's NaN must not spread
    return perceiving, grid[:, 0], grid[:, 1], grid[:, 2]
