"""What the taxels remember: counts of contact and no contact by distance and time to contact (R eqs 3–5)."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from learning.archive import read_archive, write_archive
from learning.buffer import EventBuffer, resample
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Mask

_KIND, _VERSION = "PPS memory", 1


@dataclass(frozen=True)
class MemoryParams:
    """Ranges, number of bins, and the Parzen window's standard deviation in bin widths.

    Defaults from R; the authors' own data and Matlab use TTC up to 1.2 s and 0.75 bins.
    """

    distance_range_m: tuple[float, float] = (-0.10, 0.20)
    ttc_range_s: tuple[float, float] = (0.0, 3.0)
    bins: tuple[int, int] = (8, 4)
    sigma_bins: float = 1.0

    def __post_init__(self) -> None:
        (d0, d1), (t0, t1) = self.distance_range_m, self.ttc_range_s
        if not (d0 < d1 and t0 < t1 and min(self.bins) > 0 and self.sigma_bins > 0):
            raise ValueError(f"{self}: expected ranges from low to high, at least one bin and a width above 0")

    def covers(self, distance_m: Array, ttc_s: Array) -> Mask:
        """Whether D and TTC lie within the ranges; False for NaN."""
        (d0, d1), (t0, t1) = self.distance_range_m, self.ttc_range_s
        inside: Mask = (distance_m >= d0) & (distance_m <= d1) & (ttc_s >= t0) & (ttc_s <= t1)
        return inside


@dataclass(frozen=True)
class PPSMemory:
    """`counts` (n, D bins, TTC bins, 2) of positive and negative samples; `part_index` (n,) says
    which body part a taxel is on."""

    taxel_ids: tuple[str, ...]
    part_index: NDArray[np.intp]
    counts: NDArray[np.int64]
    params: MemoryParams

    def __post_init__(self) -> None:
        n = len(self.taxel_ids)
        if self.counts.shape != (n, *self.params.bins, 2) or self.part_index.shape != (n,):
            raise ValueError(
                f"counts {self.counts.shape}, parts {self.part_index.shape}: "
                f"expected {(n, *self.params.bins, 2)} and {(n,)} for {n} taxels"
            )
        if n and self.counts.min() < 0:
            raise ValueError(f"counts down to {self.counts.min()}: expected none below 0")

    @classmethod
    def empty(cls, skin: Skin, params: MemoryParams | None = None) -> "PPSMemory":
        """A memory of nothing, for every taxel of a skin."""
        params = params or MemoryParams()
        counts = np.zeros((len(skin.taxel_ids), *params.bins, 2), dtype=np.int64)
        return cls(skin.taxel_ids, skin.part_index, counts, params)

    @cached_property
    def frequency(self) -> Array:
        """(n, D bins, TTC bins) f = n⁺/(n⁺ + n⁻), R eq. 3; 0 where nothing was ever seen."""
        total = self.counts.sum(axis=-1)
        f: Array = self.counts[..., 0] / np.maximum(total, 1)
        return f


def learn(memory: PPSMemory, buffer: EventBuffer, touched: Mask) -> PPSMemory:
    """One learning iteration (R, "Data collection"): the buffer's samples count as positive for the
    `touched` (n,) taxels and as negative for the others of the same body part; nothing changes
    on a part that was not touched."""
    if not buffer.samples or not np.any(touched):
        return memory
    return count_samples(memory, *resample(buffer), touched)


def count_samples(memory: PPSMemory, distance_m: Array, ttc_s: Array, touched: Mask) -> PPSMemory:
    """The same for samples D and TTC (T, n); NaN and what lies outside the ranges is not counted."""
    i_distance, i_ttc, inside = _bins(memory.params, distance_m, ttc_s)
    inside &= np.isin(memory.part_index, memory.part_index[touched])
    _, taxel = np.nonzero(inside)
    counts = memory.counts.copy()
    np.add.at(counts, (taxel, i_distance[inside], i_ttc[inside], np.where(touched[taxel], 0, 1)), 1)
    return replace(memory, counts=counts)


def _bins(params: MemoryParams, distance_m: Array, ttc_s: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Mask]:
    columns = []
    inside = np.ones(np.shape(distance_m), dtype=bool)
    for value, (low, high), n in zip(
        (distance_m, ttc_s), (params.distance_range_m, params.ttc_range_s), params.bins, strict=True
    ):
        within = (value >= low) & (value < high)
        inside &= within
        columns.append(np.where(within, (value - low) / (high - low) * n, 0).astype(np.intp).clip(max=n - 1))
    return columns[0], columns[1], inside


def activation(memory: PPSMemory, distance_m: ArrayLike, ttc_s: ArrayLike) -> Array:
    """(…, n) how surely each taxel expects a touch at D and TTC (…, n), in [0, 1].

    R eqs 4–5: f weighted by a Gaussian about (D, TTC), the weights of all bins adding up to 1, so
    that bins never visited speak for 0.  0 outside the ranges and for NaN.
    """
    params = memory.params
    distance, ttc = np.asarray(distance_m, dtype=float), np.asarray(ttc_s, dtype=float)
    inside = params.covers(distance, ttc)
    w_distance = _window(params, distance, params.distance_range_m, params.bins[0], inside)
    w_ttc = _window(params, ttc, params.ttc_range_s, params.bins[1], inside)
    along_ttc = (memory.frequency @ w_ttc[..., None])[..., 0]
    return np.where(inside, np.einsum("...d,...d->...", w_distance, along_ttc), 0.0)


def _window(params: MemoryParams, value: Array, limits: tuple[float, float], n: int, inside: Mask) -> Array:
    """(…, n) Gaussian weights of the bin centres about a value, adding up to 1."""
    low, high = limits
    at = np.where(inside, (value - low) * (n / (high - low)), 0.0)
    weights = np.exp(-0.5 * ((at[..., None] - (np.arange(n) + 0.5)) / params.sigma_bins) ** 2)
    scaled: Array = weights / weights.sum(axis=-1, keepdims=True)
    return scaled


def save_memory(path: Path, memory: PPSMemory) -> None:
    """Write a memory as .npz, whole or not at all."""
    p = memory.params
    arrays: dict[str, ArrayLike] = {
        "taxel_ids": np.array(memory.taxel_ids),
        "part_index": memory.part_index,
        "counts": memory.counts,
        "ranges": np.array([p.distance_range_m, p.ttc_range_s]),
        "sigma_bins": p.sigma_bins,
    }
    write_archive(path, _KIND, _VERSION, arrays)


def load_memory(path: Path) -> PPSMemory:
    """Read a memory; ValueError names the file and what is wrong with it."""
    names = ("taxel_ids", "part_index", "counts", "ranges", "sigma_bins")
    data = read_archive(path, _KIND, _VERSION, names)
    try:
        counts = data["counts"].astype(np.int64, casting="same_kind")
        (d0, d1), (t0, t1) = np.asarray(data["ranges"], dtype=float)
        params = MemoryParams((d0, d1), (t0, t1), (counts.shape[1], counts.shape[2]), float(data["sigma_bins"]))
        taxel_ids = tuple(str(name) for name in data["taxel_ids"])
        return PPSMemory(taxel_ids, data["part_index"].astype(np.intp, casting="same_kind"), counts, params)
    except (ValueError, TypeError, IndexError) as error:
        raise ValueError(f"{path}: {_KIND} that does not fit together: {error}") from error
