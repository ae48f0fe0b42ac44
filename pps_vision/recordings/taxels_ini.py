"""The robot's own maps of peripersonal space, taxels*.ini: counts of every virtual taxel, by body part.

The 1-D form knows the distance D only, the 2-D form D and time to contact TTC.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.recordings.text import finite, whole
from pps_vision.recordings.yarp_text import Section, read_sections

_KEYS = ("modality", "size", "nTaxels", "ext", "binsNum", "Mapping")
_LIMITS = {"1D": 2, "2D": 4}  # numbers in ext
_LARGEST = 2**53  # as in the memory that they are converted to

OUR_NAMES = {
    **{"l_hand": "left_palm", "l_forearm": "left_forearm", "l_upper_arm": "left_upper_arm"},
    **{"r_hand": "right_palm", "r_forearm": "right_forearm", "r_upper_arm": "right_upper_arm"},
}
"""Of the parts that the robot calls otherwise."""


@dataclass(frozen=True)
class PartMap:
    """Learned map of one body part.

    `mapping` (size,) says which virtual taxel each physical one belongs to, −1 none; `extent` is the range of
    D in m and, in 2-D, of TTC in s (low, high each); `counts` by virtual taxel are (D bins, TTC bins, 2)
    positive and negative samples, in 1-D with one TTC bin.
    """

    name: str
    extent: tuple[float, ...]
    bins: tuple[int, int]
    mapping: tuple[int, ...]
    counts: Mapping[int, NDArray[np.int64]]


def read_taxels(file: Path) -> tuple[PartMap, ...]:
    """Return the maps of a taxels*.ini, one a body part.  InputError where the file is malformed; the message names
    file, line and value."""
    sections = read_sections(file, "a taxels*.ini")
    for entry in sections.pop("").entries.values():
        raise entry.error("a [body part] first")
    if not sections:
        raise InputError(file, "no section; expected one [body part] or more")
    return tuple(_part(section) for section in sections.values())


def representatives(maps: Sequence[PartMap]) -> dict[str, tuple[int, ...]]:
    """Virtual taxel of each physical taxel (−1: none), by our name of the body part."""
    return {OUR_NAMES.get(part.name, part.name): part.mapping for part in maps}


def _part(section: Section) -> PartMap:
    """Return the map that one section holds."""
    modality, size, n_taxels, ext, bins_num, mapping_of = section.required(_KEYS)
    if modality.text not in _LIMITS:
        raise modality.error(" or ".join(_LIMITS))
    extent = ext.lists(finite, _LIMITS[modality.text])[0]
    n_distances, n_times = bins_num.lists(whole, 2)[0]
    mapping = mapping_of.lists(whole, size.number(whole))[0]
    if any(low >= high for low, high in zip(extent[::2], extent[1::2], strict=True)):
        raise ext.error("ranges from low to high")
    if min(n_distances, n_times) < 1 or (modality.text == "1D" and n_times != 1):
        raise bins_num.error("bins, in 1D one of TTC")
    counts = {}
    for key, entry in section.entries.items():
        if key in _KEYS:
            continue
        if not (key.isascii() and key.isdecimal() and len(key) < 10):
            raise entry.error(f"{', '.join(_KEYS)} and the numbers of taxels")
        count_lists = entry.lists(whole, n_distances * n_times, 2)
        if not 0 <= min(map(min, count_lists)) <= max(map(max, count_lists)) <= _LARGEST:
            raise entry.error("counts from 0 to 2^53")
        samples = [np.array(values, np.int64).reshape(n_distances, n_times) for values in count_lists]
        counts[int(key)] = np.stack(samples, axis=-1)
    if len(counts) != n_taxels.number(whole):
        raise n_taxels.error(f"{len(counts)}, as many taxels as follow")
    return PartMap(section.name, extent, (n_distances, n_times), mapping, counts)


def write_taxels(file: Path, parts: Sequence[PartMap]) -> None:
    """Write a taxels*.ini as the robot does; read again it is the same."""
    rows: list[str] = []
    for part in parts:
        modality = next(name for name, n in _LIMITS.items() if n == len(part.extent))
        rows += [
            f"[{part.name}]",
            f"modality\t{modality}",
            f"size    \t{len(part.mapping)}",
            f"nTaxels \t{len(part.counts)}",
            f"ext     \t{_list(map(float, part.extent))}",
            f"binsNum \t({part.bins[0]}\t{part.bins[1]})",
            f"Mapping\t{_list(part.mapping)}",
            *(f"{taxel} {_list(n[..., 0].ravel())} {_list(n[..., 1].ravel())}" for taxel, n in part.counts.items()),
        ]
    file.write_text("".join(f"{row}\n" for row in rows))


def _list(numbers: Iterable[float]) -> str:
    return f"({' '.join(map(str, numbers))})"
