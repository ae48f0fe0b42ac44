"""Memory of the taxels: counts of touch and no touch by distance and time to contact (R eqs 3–5), and by the distance
at which the object is predicted to miss the taxel (ours)."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from learning.archive import read_archive, write_archive
from learning.pps.buffer import EventBuffer, resample
from pps_vision.errors import InputError
from pps_vision.jit import njit
from pps_vision.robot.skin import Skin, SkinPart
from pps_vision.types import Array, Mask

MOST_COUNTS = 2**53  # counts of a bin: a float holds every whole number up to it, and 64 bits the sums of all bins
_KIND = "PPS memory"
_VERSION = 7
"""Up to version 2, D was to the centre; up to 3, there was no miss distance; up to 4, paths led through the arm; up to
5, the body was taken as it is; up to 6, the skin ended where the body does."""
_LARGEST = 1e9  # largest limit of a range, and inverse of its least width; keeps divisions finite

Counts = NDArray[np.integer[Any] | np.floating[Any]]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class MemoryParams:
    """Bins and smoothing of the memory; defaults from R (`PROBABILITY` has ours).

    With a single bin in a dimension its range may be infinite: (8, 1) bins over (−inf, inf) s depend on D only.
    """

    distance_range_m: tuple[float, float] = (-0.10, 0.20)
    """Range of D (R)."""
    ttc_range_s: tuple[float, float] = (0.0, 3.0)
    """Range of TTC (R); the authors' data and Matlab code use 1.2 s."""
    bins: tuple[int, ...] = (8, 4)
    """Number of bins of D and of TTC (R); with a third number, of the predicted miss distance too."""
    sigma_bins: float = 1.0
    """Standard deviation of the Parzen window in bin widths (R); the authors' data and Matlab code use 0.75."""
    miss_range_m: tuple[float, float] = (0.0, 0.12)
    """Range of the predicted miss distance; a value beyond counts in the outermost bin."""
    prior_samples: tuple[float, float] = (2.0, 1.0)
    """Samples that a taxel's own count as against its body part's, and the body part's as against probability 0."""

    def __post_init__(self) -> None:
        d0, d1 = self.distance_range_m
        t0, t1 = self.ttc_range_s
        is_ordered = d0 < d1 and t0 < t1 and self.miss_range_m[0] < self.miss_range_m[1]
        has_bins = len(self.bins) in (2, 3) and min(self.bins) > 0
        if not (is_ordered and has_bins and 1 / _LARGEST <= self.sigma_bins <= _LARGEST):
            raise ValueError(f"{self}: expected ranges from low to high, at least one bin and a width above 0")
        if not 0 <= min(self.prior_samples) <= max(self.prior_samples) <= _LARGEST:
            raise ValueError(f"{self}: expected prior samples from 0 on")
        ranges = (self.distance_range_m, self.ttc_range_s, self.miss_range_m)[: len(self.bins)]
        for limits, n in zip(ranges, self.bins, strict=True):
            if n > 1 and not (limits[1] - limits[0] >= 1 / _LARGEST and max(map(abs, limits)) <= _LARGEST):
                raise ValueError(f"{self}: expected a finite range where there is more than one bin")

    @property
    def knows_path(self) -> bool:
        """Whether the activation is a probability that depends on the predicted miss distance too."""
        return len(self.bins) == 3

    def covers(self, distance_m: Array, ttc_s: Array) -> Mask:
        """Whether D and TTC lie within the ranges; False for NaN."""
        d0, d1 = self.distance_range_m
        t0, t1 = self.ttc_range_s
        return (distance_m >= d0) & (distance_m <= d1) & (ttc_s >= t0) & (ttc_s <= t1)


PROBABILITY = MemoryParams((-0.20, 0.20), bins=(11, 4, 12), sigma_bins=0.5)
"""Ours: the probability of touch by D, TTC and predicted miss distance; an object that grazes a taxel may come from
behind the plane of its skin."""


@dataclass(frozen=True)
class PPSMemory:
    """Counts of touch and no touch of n taxels."""

    taxel_ids: tuple[str, ...]  # names of the taxels, "part:id"
    part_index: Indices  # (n,) body part of each taxel
    counts: Counts  # (n, D bins, TTC bins, miss bins if any, 2) positive and negative samples
    params: MemoryParams  # bins and smoothing of the counts
    written_by: str = ""  # version of this package that wrote the file it was read from
    offsets_rad: Array = field(default_factory=lambda: np.zeros(0))
    """(n_joints,) to add to the encoders, as it was learned with them; empty: the encoders are as they should be."""
    positions_m: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(n − k, 3) of the taxels in the frames of their parts, as it was learned with them; empty: the skin's own."""
    places: Array = field(default_factory=lambda: np.zeros((0, 7)))
    """(k, 7) places beyond the skin, which are the last k of the n taxels: the sums of the touched points (3,) in m and
    of the unit vectors (3,) to the objects, in the frames of their parts, and the number of touches."""

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
        own = self.n_own
        if self.places.shape[1:] != (7,) or own < 0 or not np.isin(self.part_index[own:], self.part_index[:own]).all():
            raise ValueError(f"places {self.places.shape}: expected 7 numbers of each, on body parts with taxels")
        if not (np.abs(self.places) < _LARGEST).all() or not self.places[:, 3:].any(axis=1).all():
            raise ValueError("places: expected finite ones with a direction")
        if self.positions_m.shape not in ((0, 3), (own, 3)) or self.offsets_rad.ndim != 1:
            shapes = f"positions {self.positions_m.shape}, offsets {self.offsets_rad.shape}"
            raise ValueError(f"{shapes}: expected {(own, 3)} and one of each joint, or none")
        if not (np.abs(self.positions_m) < _LARGEST).all() or not (np.abs(self.offsets_rad) < np.pi).all():
            raise ValueError("positions or offsets of joints: expected finite ones, offsets within ±180°")

    @classmethod
    def empty(cls, skin: Skin, params: MemoryParams | None = None) -> "PPSMemory":
        """A memory without samples for every taxel of a skin; default: ours, `PROBABILITY`."""
        params = params or PROBABILITY
        counts = np.zeros((len(skin.taxel_ids), *params.bins, 2), dtype=np.int64)
        return cls(skin.taxel_ids, skin.part_index, counts, params)

    @classmethod
    def constant(cls, skin: Skin, params: MemoryParams | None = None) -> "PPSMemory":
        """A memory that has learned nothing: activation 1 everywhere within the ranges."""
        memory = cls.empty(skin, params or MemoryParams())
        return replace(memory, counts=memory.counts + np.array([1, 0]))

    @property
    def n_own(self) -> int:
        """Number of the skin's own taxels, before the places beyond it."""
        return len(self.taxel_ids) - len(self.places)

    def skin_of(self, skin: Skin) -> Skin:
        """The skin with the taxels where they were learned to be, and the places beyond it as further taxels."""
        parts = list(skin.parts)
        if len(self.positions_m):
            positions = [self.positions_m[skin.part_index == k] for k in range(len(skin.parts))]
            parts = [replace(part, positions_m=at) for part, at in zip(skin.parts, positions, strict=True)]
        for k, place in enumerate(self.places):
            of = skin.parts[self.part_index[self.n_own + k]]
            point, normal = place[None, :3] / place[6], place[None, 3:6] / np.linalg.norm(place[3:6])
            parts.append(SkinPart(f"{of.name}_tool", of.frame, (k,), point, normal, of.margin))
        return Skin(tuple(parts))

    @cached_property
    def frequency(self) -> Array:
        """(n, D bins, TTC bins) f = n⁺/(n⁺ + n⁻), R eq. 3; 0 without samples."""
        total = self.counts[..., 0] + self.counts[..., 1]
        return self.counts[..., 0] / np.maximum(total, 1)

    @property
    def samples(self) -> NDArray[Any]:
        """(n, 2) all positive and negative samples of each taxel."""
        totals: NDArray[Any] = self.counts.reshape(len(self.counts), -1, 2).sum(axis=1)
        return totals

    @cached_property
    def sums(self) -> tuple[Array, Array, Array, Array]:
        """n⁺ and n of every taxel (n, bins), N⁺ and N of every body part (parts, bins)."""
        counts = np.stack([self.counts[..., 0], self.counts.sum(axis=-1)]).astype(float)
        parts = np.zeros((2, int(self.part_index.max(initial=-1)) + 1, *self.params.bins))
        for k, part in enumerate(self.part_index.tolist()):
            parts[:, part] += counts[:, k]
        return counts[0], counts[1], parts[0], parts[1]


def learn(memory: PPSMemory, buffer: EventBuffer, touched: Mask | None) -> PPSMemory:
    """One learning iteration (R, "Data collection"): the buffer's samples count as positive for the `touched` (n,)
    taxels and as negative for the others of the same body part; nothing changes on a part that was not touched.

    None: the object came near and touched nothing, so that the samples count as negative for every taxel.  Ours: R
    learns from touches only, and its negative samples stem from the taxels beside the touched ones.  In a memory that
    knows the path the parts that were not touched learn too.
    """
    taxels = np.arange(len(memory.taxel_ids)) if touched is None else _learning(memory, touched)
    if not buffer:
        return memory
    if buffer[0].taxel_ids != memory.taxel_ids:
        raise ValueError(f"a buffer of {len(buffer[0].taxel_ids)} taxels: expected those of the memory")
    if touched is None:
        touched = np.zeros(len(memory.taxel_ids), bool)
    return _counted(memory, *resample(buffer, taxels), touched)


def count_samples(
    memory: PPSMemory, distance_m: Array, ttc_s: Array, touched: Mask, miss_m: ArrayLike = -np.inf
) -> PPSMemory:
    """Count samples D, TTC and predicted miss distance (…, n) of one touch; NaN and values outside the ranges of D and
    TTC do not count.

    Returns the memory itself if no sample counts.
    """
    D, ttc, miss = paired(memory, distance_m, ttc_s, miss_m)
    taxels = _learning(memory, touched)
    return _counted(memory, taxels, D[..., taxels], ttc[..., taxels], miss[..., taxels], touched)


def _learning(memory: PPSMemory, touched: Mask) -> Indices:
    """Indices of the taxels of the body parts that were touched; ValueError unless `touched` is (n,)."""
    if touched.shape != memory.part_index.shape:
        raise ValueError(f"touched {touched.shape}: expected the memory's {len(memory.taxel_ids)} taxels")
    if memory.params.knows_path and touched.any():
        return np.arange(len(touched))
    return np.flatnonzero(np.isin(memory.part_index, memory.part_index[touched]))


def _counted(
    memory: PPSMemory, taxels: Indices, distance_m: Array, ttc_s: Array, miss_m: Array, touched: Mask
) -> PPSMemory:
    """As `count_samples`, with D, TTC and miss distance (…, k) of these k `taxels`."""
    params = memory.params
    sampled = params.covers(distance_m, ttc_s)
    i_distance, at_distance = _bins(distance_m[sampled], params.distance_range_m, params.bins[0])
    i_ttc, at_ttc = _bins(ttc_s[sampled], params.ttc_range_s, params.bins[1])
    counted = at_distance & at_ttc
    if not counted.any():
        return memory
    taxel = taxels[np.nonzero(sampled)[-1][counted]]
    cell = [i_distance[counted], i_ttc[counted]]
    if params.knows_path:
        low, high = params.miss_range_m
        i_miss, _ = _bins(np.clip(miss_m[sampled][counted], low, high), (low, high), params.bins[2])
        cell.append(i_miss)
    counts = memory.counts.copy()
    np.add.at(counts, (taxel, *cell, np.where(touched[taxel], 0, 1)), 1)
    return replace(memory, counts=counts)


def _bins(value: Array, limits: tuple[float, float], n: int) -> tuple[Indices, Mask]:
    """The bins (k,) of values within the limits, and which of them count: the upper limit itself does not."""
    if n == 1:
        return np.zeros(len(value), np.intp), value < limits[1]
    low, high = limits
    return ((value - low) / (high - low) * n).astype(np.intp).clip(max=n - 1), value < high


def activation(memory: PPSMemory, distance_m: ArrayLike, ttc_s: ArrayLike, miss_m: ArrayLike = -np.inf) -> Array:
    """(…, n) activation in [0, 1] of each taxel at D, TTC and predicted miss distance (…, n).

    With bins of D and TTC alone, R eqs 4–5: f weighted by a Gaussian about (D, TTC), the weights of all bins adding up
    to 1, so that bins without samples count as 0.  With bins of the miss distance too, the probability of touch: n⁺, n
    smoothed by that Gaussian, and P = (n⁺ + κ P_part)/(n + κ) with P_part = N⁺/(N + κ₀) of the sums N over the body
    part.  0 outside the ranges of D and TTC and for NaN.  The default miss distance is that of an object on its way to
    the taxel itself.
    """
    places = paired(memory, distance_m, ttc_s, miss_m)
    inside = memory.params.covers(*places[:2])
    activations = np.zeros(inside.shape)
    at = np.nonzero(inside)  # few of a whole skin's taxels perceive one stimulus
    if not len(at[0]):
        return activations
    place = [values[at] for values in places]
    params = memory.params
    if params.knows_path:
        of_taxel, of_part = params.prior_samples
        taxel = at[-1]
        part = memory.part_index[taxel]
        touch, total, part_touch, part_total = (
            smoothed(params, sums, index, *place)
            for sums, index in zip(memory.sums, (taxel, taxel, part, part), strict=True)
        )
        of_the_part = part_touch / (part_total + of_part)
        activations[at] = (touch + of_taxel * of_the_part) / (total + of_taxel)
    else:
        activations[at] = smoothed(params, memory.frequency, at[-1], *place)
    return np.minimum(activations, 1.0)  # against rounding


def smoothed(
    params: MemoryParams, bins: Array, index: Indices, distance_m: Array, ttc_s: Array, miss_m: Array | None = None
) -> Array:
    """(k,) mean of a row of `bins` (n, D bins, TTC bins, …), weighted by the Parzen window about k places within the
    ranges, of the rows with these k indices."""
    ranges = np.array([params.distance_range_m, params.ttc_range_s, params.miss_range_m])
    cells = bins.reshape(len(bins), *bins.shape[1:3], -1)
    miss = np.zeros(len(index)) if miss_m is None else np.clip(miss_m, *params.miss_range_m)
    return _smoothed(cells, index, distance_m, ttc_s, miss, ranges, params.sigma_bins)


@njit(cache=True, error_model="numpy")
def _smoothed(
    bins: Array, index: Indices, distance_m: Array, ttc_s: Array, miss_m: Array, ranges: Array, sigma_bins: float
) -> Array:
    """As `smoothed`."""
    means = np.empty(len(index))
    _, n_distance, n_ttc, n_miss = bins.shape
    w_distance = np.empty(n_distance)
    w_ttc = np.empty(n_ttc)
    w_miss = np.empty(n_miss)
    step = math.exp(-1 / sigma_bins**2)
    for i in range(len(index)):
        _weigh(w_distance, distance_m[i], ranges[0, 0], ranges[0, 1], sigma_bins, step)
        _weigh(w_ttc, ttc_s[i], ranges[1, 0], ranges[1, 1], sigma_bins, step)
        _weigh(w_miss, miss_m[i], ranges[2, 0], ranges[2, 1], sigma_bins, step)
        total = 0.0
        for j in range(n_distance):
            for k in range(n_ttc):
                row = 0.0
                for m in range(n_miss):
                    row += w_miss[m] * bins[index[i], j, k, m]
                total += w_distance[j] * w_ttc[k] * row
        means[i] = total / (w_distance.sum() * w_ttc.sum() * w_miss.sum())
    return means


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


def paired(memory: PPSMemory, *values: ArrayLike) -> tuple[Array, ...]:
    """Values as arrays (…, n) of one shape; ValueError where they are not of the memory's n taxels."""
    arrays = [np.asarray(value, dtype=float) for value in values]
    n = len(memory.taxel_ids)
    if any(a.shape[-1:] not in ((), (1,), (n,)) for a in arrays):
        shapes = ", ".join(str(a.shape) for a in arrays)
        raise ValueError(f"D, TTC and miss distance {shapes}: expected those of the memory's {n} taxels")
    return tuple(np.broadcast_arrays(*arrays, np.empty(n))[:-1])


def save_memory(path: Path, memory: PPSMemory) -> None:
    """Write a memory as .npz, whole or not at all."""
    params = memory.params
    arrays: dict[str, ArrayLike] = {
        "taxel_ids": np.array(memory.taxel_ids),
        "part_index": memory.part_index,
        "counts": memory.counts,
        "ranges": np.array([params.distance_range_m, params.ttc_range_s, params.miss_range_m]),
        "smoothing": np.array([params.sigma_bins, *params.prior_samples]),
        "offsets_rad": memory.offsets_rad,
        "positions_m": memory.positions_m,
        "places": memory.places,
    }
    write_archive(path, _KIND, _VERSION, arrays)


def load_memory(path: Path) -> PPSMemory:
    """Read a memory; InputError names the file and the expected content."""
    names = "taxel_ids", "part_index", "counts", "ranges", "smoothing", "offsets_rad", "positions_m", "places"
    data = read_archive(path, _KIND, _VERSION, names)
    try:
        stored = data["counts"]
        counts: Counts = stored.astype(np.float64 if stored.dtype.kind == "f" else np.int64, casting="same_kind")
        (d0, d1), (t0, t1), (m0, m1) = np.asarray(data["ranges"], dtype=float).tolist()
        sigma, of_taxel, of_part = np.asarray(data["smoothing"], dtype=float).tolist()
        params = MemoryParams((d0, d1), (t0, t1), counts.shape[1:-1], sigma, (m0, m1), (of_taxel, of_part))
        taxel_ids = tuple(str(name) for name in data["taxel_ids"])
        part_index = data["part_index"].astype(np.intp, casting="same_kind")
        body = (np.asarray(data[name], dtype=float) for name in names[5:])
        return PPSMemory(taxel_ids, part_index, counts, params, str(data["written_by"]), *body)
    except (ValueError, TypeError, IndexError) as error:
        raise InputError(path, f"{_KIND} that does not fit together: {error}") from error
