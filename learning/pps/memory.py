"""Memory of the taxels: counts of touch and no touch by distance and time to contact (R eqs 3–5)."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from learning.archive import read_archive, write_archive
from learning.pps.buffer import EventBuffer, resample
from pps_vision.errors import InputError
from pps_vision.jit import njit
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Mask

MOST_COUNTS = 2**53  # of a bin: a float holds every whole number up to it, and 64 bits the sums of all bins
_KIND = "PPS memory"
_VERSION = 3  # up to version 2, D was to the centre of the object
_LARGEST = 1e9  # largest limit of a range, and inverse of its least width; keeps divisions finite
_TORCH_ROWS = 1 << 18  # cases at a time on a torch device, about 100 MB

Counts = NDArray[np.integer[Any] | np.floating[Any]]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class MemoryParams:
    """Bins and smoothing of the memory; defaults from R.

    With a single bin in a dimension its range may be infinite: (8, 1) bins over (−inf, inf) s depend on D only.
    """

    distance_range_m: tuple[float, float] = (-0.10, 0.20)
    """Range of D (R)."""
    ttc_range_s: tuple[float, float] = (0.0, 3.0)
    """Range of TTC (R); the authors' data and Matlab code use 1.2 s."""
    bins: tuple[int, int] = (8, 4)
    """Number of bins of D and of TTC (R)."""
    sigma_bins: float = 1.0
    """Standard deviation of the Parzen window in bin widths (R); the authors' data and Matlab code use 0.75."""

    def __post_init__(self) -> None:
        d0, d1 = self.distance_range_m
        t0, t1 = self.ttc_range_s
        if not (d0 < d1 and t0 < t1 and min(self.bins) > 0 and 1 / _LARGEST <= self.sigma_bins <= _LARGEST):
            raise ValueError(f"{self}: expected ranges from low to high, at least one bin and a width above 0")
        for limits, n in zip((self.distance_range_m, self.ttc_range_s), self.bins, strict=True):
            if n > 1 and not (limits[1] - limits[0] >= 1 / _LARGEST and max(map(abs, limits)) <= _LARGEST):
                raise ValueError(f"{self}: expected a finite range where there is more than one bin")

    def covers(self, distance_m: Array, ttc_s: Array) -> Mask:
        """Whether D and TTC lie within the ranges; False for NaN."""
        d0, d1 = self.distance_range_m
        t0, t1 = self.ttc_range_s
        return (distance_m >= d0) & (distance_m <= d1) & (ttc_s >= t0) & (ttc_s <= t1)


@dataclass(frozen=True)
class PPSMemory:
    """Counts of touch and no touch of n taxels."""

    taxel_ids: tuple[str, ...]  # names of the taxels, "part:id"
    part_index: Indices  # (n,) body part of each taxel
    counts: Counts  # (n, D bins, TTC bins, 2) positive and negative samples
    params: MemoryParams  # bins and smoothing of the counts
    written_by: str = ""  # version of this package that wrote the file it was read from

    def __post_init__(self) -> None:
        n = len(self.taxel_ids)
        if self.counts.shape != (n, *self.params.bins, 2) or self.part_index.shape != (n,):
            raise ValueError(
                f"counts {self.counts.shape}, parts {self.part_index.shape}: "
                f"expected {(n, *self.params.bins, 2)} and {(n,)} for {n} taxels"
            )
        if n and not (self.counts.min() >= 0 and self.counts.max() <= MOST_COUNTS):
            extremes = f"from {self.counts.min()} to {self.counts.max()}"
            raise ValueError(f"counts {extremes}: expected finite ones from 0 to 2^53")
        if len(set(self.taxel_ids)) < n:
            raise ValueError(f"{n} taxels, {len(set(self.taxel_ids))} different names: expected each taxel once")

    @classmethod
    def empty(cls, skin: Skin, params: MemoryParams | None = None) -> "PPSMemory":
        """A memory without samples for every taxel of a skin."""
        params = params or MemoryParams()
        counts = np.zeros((len(skin.taxel_ids), *params.bins, 2), dtype=np.int64)
        return cls(skin.taxel_ids, skin.part_index, counts, params)

    @classmethod
    def constant(cls, skin: Skin, params: MemoryParams | None = None) -> "PPSMemory":
        """A memory that has learned nothing: activation 1 everywhere within the ranges."""
        memory = cls.empty(skin, params)
        return replace(memory, counts=memory.counts + np.array([1, 0]))

    @cached_property
    def frequency(self) -> Array:
        """(n, D bins, TTC bins) f = n⁺/(n⁺ + n⁻), R eq. 3; 0 without samples."""
        total = self.counts[..., 0] + self.counts[..., 1]
        return self.counts[..., 0] / np.maximum(total, 1)


def learn(memory: PPSMemory, buffer: EventBuffer, touched: Mask | None) -> PPSMemory:
    """One learning iteration (R, "Data collection"): the buffer's samples count as positive for the `touched` (n,)
    taxels and as negative for the others of the same body part; nothing changes on a part that was not touched.

    None: the object came near and touched nothing, so that the samples count as negative for every taxel.  Ours: R
    learns from touches only, and its negative samples stem from the taxels beside the touched ones.
    """
    taxels = np.arange(len(memory.taxel_ids)) if touched is None else _learning(memory, touched)
    if not buffer:
        return memory
    if buffer[0].taxel_ids != memory.taxel_ids:
        raise ValueError(f"a buffer of {len(buffer[0].taxel_ids)} taxels: expected those of the memory")
    if touched is None:
        touched = np.zeros(len(memory.taxel_ids), bool)
    return _counted(memory, *resample(buffer, taxels), touched)


def count_samples(memory: PPSMemory, distance_m: Array, ttc_s: Array, touched: Mask) -> PPSMemory:
    """Count samples D and TTC (…, n) of one touch; NaN and values outside the ranges do not count.

    Returns the memory itself if no sample counts.
    """
    distance_m, ttc_s = paired(memory, distance_m, ttc_s)
    taxels = _learning(memory, touched)
    return _counted(memory, taxels, distance_m[..., taxels], ttc_s[..., taxels], touched)


def _learning(memory: PPSMemory, touched: Mask) -> Indices:
    """Indices of the taxels of the body parts that were touched; ValueError unless `touched` is (n,)."""
    if touched.shape != memory.part_index.shape:
        raise ValueError(f"touched {touched.shape}: expected the memory's {len(memory.taxel_ids)} taxels")
    return np.flatnonzero(np.isin(memory.part_index, memory.part_index[touched]))


def _counted(memory: PPSMemory, taxels: Indices, distance_m: Array, ttc_s: Array, touched: Mask) -> PPSMemory:
    """As `count_samples`, with D and TTC (…, k) of these k `taxels`."""
    params = memory.params
    sampled = params.covers(distance_m, ttc_s)
    i_distance, at_distance = _bins(distance_m[sampled], params.distance_range_m, params.bins[0])
    i_ttc, at_ttc = _bins(ttc_s[sampled], params.ttc_range_s, params.bins[1])
    counted = at_distance & at_ttc
    if not counted.any():
        return memory
    taxel = taxels[np.nonzero(sampled)[-1][counted]]
    counts = memory.counts.copy()
    np.add.at(counts, (taxel, i_distance[counted], i_ttc[counted], np.where(touched[taxel], 0, 1)), 1)
    return replace(memory, counts=counts)


def _bins(value: Array, limits: tuple[float, float], n: int) -> tuple[Indices, Mask]:
    """The bins (k,) of values within the limits, and which of them count: the upper limit itself does not."""
    if n == 1:
        return np.zeros(len(value), np.intp), value < limits[1]
    low, high = limits
    return ((value - low) / (high - low) * n).astype(np.intp).clip(max=n - 1), value < high


def activation(memory: PPSMemory, distance_m: ArrayLike, ttc_s: ArrayLike, device: str | None = None) -> Array:
    """(…, n) activation in [0, 1] of each taxel at D and TTC (…, n).

    R eqs 4–5: f weighted by a Gaussian about (D, TTC), the weights of all bins adding up to 1, so that bins without
    samples count as 0.  0 outside the ranges and for NaN.  `device`: compute with torch there (cpu, cuda, …).
    """
    distance, ttc = paired(memory, distance_m, ttc_s)
    inside = memory.params.covers(distance, ttc)
    activations = np.zeros(inside.shape)
    at = np.nonzero(inside)  # few of a whole skin's taxels perceive one stimulus
    if len(at[0]) and device is not None:
        activations[at] = _smoothed_by_torch(memory, at[-1], distance[at], ttc[at], device)
    elif len(at[0]):
        activations[at] = smoothed(memory.params, memory.frequency, at[-1], distance[at], ttc[at])
    return np.minimum(activations, 1.0)  # against rounding


def smoothed(params: MemoryParams, bins: Array, taxel: Indices, distance_m: Array, ttc_s: Array) -> Array:
    """(k,) mean of a taxel's `bins` (n, D bins, TTC bins), weighted by the Parzen window about k pairs D, TTC within
    the ranges, of the taxels with these k indices."""
    ranges = np.array([params.distance_range_m, params.ttc_range_s])
    return _smoothed(bins, taxel, distance_m, ttc_s, ranges, params.sigma_bins)


@njit(cache=True, error_model="numpy")
def _smoothed(bins: Array, taxel: Indices, distance_m: Array, ttc_s: Array, ranges: Array, sigma_bins: float) -> Array:
    """As `smoothed`."""
    means = np.empty(len(taxel))
    _, n_distance, n_ttc = bins.shape
    w_distance = np.empty(n_distance)
    w_ttc = np.empty(n_ttc)
    step = math.exp(-1 / sigma_bins**2)
    for i in range(len(taxel)):
        _weigh(w_distance, distance_m[i], ranges[0, 0], ranges[0, 1], sigma_bins, step)
        _weigh(w_ttc, ttc_s[i], ranges[1, 0], ranges[1, 1], sigma_bins, step)
        total = 0.0
        for j in range(n_distance):
            row = 0.0
            for k in range(n_ttc):
                row += w_ttc[k] * bins[taxel[i], j, k]
            total += w_distance[j] * row
        means[i] = total / (w_distance.sum() * w_ttc.sum())
    return means


def _smoothed_by_torch(memory: PPSMemory, taxel: Indices, distance_m: Array, ttc_s: Array, device: str) -> Array:
    """(k,) frequencies by `smoothed`, on a torch device."""
    import torch  # takes seconds to load

    def weights(value: torch.Tensor, limits: tuple[float, float], n: int) -> torch.Tensor:
        if n == 1:
            return torch.ones_like(value)[:, None]
        per_unit = n / (limits[1] - limits[0])
        bins = torch.arange(n, device=value.device, dtype=value.dtype)
        offset = (value * per_unit)[:, None] - (limits[0] * per_unit + 0.5 + bins)
        return torch.softmax(-offset.square() / (2 * params.sigma_bins**2), dim=1)

    params = memory.params
    frequency = torch.from_numpy(memory.frequency).to(device)
    activations = []
    parts = (torch.split(torch.from_numpy(v).to(device), _TORCH_ROWS) for v in (taxel, distance_m, ttc_s))
    for index, distance, ttc in zip(*parts, strict=True):
        w_distance = weights(distance, params.distance_range_m, params.bins[0])
        w_ttc = weights(ttc, params.ttc_range_s, params.bins[1])
        activations.append(torch.einsum("kd,kdt,kt->k", w_distance, frequency[index], w_ttc))
    return torch.cat(activations).cpu().numpy()


@njit(cache=True, error_model="numpy")
def _weigh(weights: Array, value: float, low: float, high: float, sigma_bins: float, step: float) -> None:
    """Fill in the Gaussian weights of the bins about a value, that of the nearest bin 1.

    From bin to bin the ratio of weights falls by the factor `step`, exp(−1/σ²): two exponentials do for all bins.
    """
    n = len(weights)
    weights[:] = 1.0
    if n == 1:
        return
    place = (value - low) / (high - low) * n - 0.5
    nearest = min(max(int(place + 0.5), 0), n - 1)
    for way, last in ((1, n - 1), (-1, 0)):
        ratio = math.exp(min((2 * way * (place - nearest) - 1) / (2 * sigma_bins**2), 0.0))
        weight = 1.0
        for j in range(nearest + way, last + way, way):
            weight *= ratio
            ratio *= step
            weights[j] = weight


def paired(memory: PPSMemory, distance_m: ArrayLike, ttc_s: ArrayLike) -> tuple[Array, Array]:
    """D and TTC as arrays (…, n) of one shape; ValueError where they are not of the memory's n taxels."""
    distance = np.asarray(distance_m, dtype=float)
    ttc = np.asarray(ttc_s, dtype=float)
    n = len(memory.taxel_ids)
    if distance.shape == ttc.shape and distance.shape[-1:] == (n,):
        return distance, ttc
    if any(a.shape[-1:] not in ((), (1,), (n,)) for a in (distance, ttc)):
        raise ValueError(f"D {distance.shape}, TTC {ttc.shape}: expected those of the memory's {n} taxels")
    distance, ttc, _ = np.broadcast_arrays(distance, ttc, np.empty(n))
    return distance, ttc


def save_memory(path: Path, memory: PPSMemory) -> None:
    """Write a memory as .npz, whole or not at all."""
    params = memory.params
    arrays: dict[str, ArrayLike] = {
        "taxel_ids": np.array(memory.taxel_ids),
        "part_index": memory.part_index,
        "counts": memory.counts,
        "ranges": np.array([params.distance_range_m, params.ttc_range_s]),
        "sigma_bins": params.sigma_bins,
    }
    write_archive(path, _KIND, _VERSION, arrays)


def load_memory(path: Path) -> PPSMemory:
    """Read a memory; InputError names the file and the expected content."""
    data = read_archive(path, _KIND, _VERSION, ("taxel_ids", "part_index", "counts", "ranges", "sigma_bins"))
    try:
        stored = data["counts"]
        counts: Counts = stored.astype(np.float64 if stored.dtype.kind == "f" else np.int64, casting="same_kind")
        (d0, d1), (t0, t1) = np.asarray(data["ranges"], dtype=float).tolist()
        params = MemoryParams((d0, d1), (t0, t1), (counts.shape[1], counts.shape[2]), float(data["sigma_bins"]))
        taxel_ids = tuple(str(name) for name in data["taxel_ids"])
        part_index = data["part_index"].astype(np.intp, casting="same_kind")
        return PPSMemory(taxel_ids, part_index, counts, params, str(data["written_by"]))
    except (ValueError, TypeError, IndexError) as error:
        raise InputError(path, f"{_KIND} that does not fit together: {error}") from error
