"""The robot's own maps of peripersonal space, taxels*.ini: counts of every virtual taxel, by body part.

The 1-D form knows the distance D only, the 2-D form D and time to contact TTC.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError, first_line

_KEYS = ("modality", "size", "nTaxels", "ext", "binsNum", "Mapping")
_LIMITS = {"1D": 2, "2D": 4}  # numbers in ext
_LARGEST = 2**63 - 1

OUR_NAMES = {
    "l_hand": "left_palm",
    "r_hand": "right_palm",
    "l_forearm": "left_forearm",
    "r_forearm": "right_forearm",
}
"""Of the parts that the robot calls otherwise."""

Entry = tuple[str, int]  # the text after a key, and its line
Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class PartMap:
    """What one body part has learned.

    `mapping` (size,) says which virtual taxel each physical one belongs to, −1 none; `extent` is the range of
    D in m and, in 2-D, of TTC in s (low, high each); `counts` by virtual taxel are (D bins, TTC bins, 2)
    positive and negative samples, in 1-D with one TTC bin.
    """

    name: str
    extent: tuple[float, ...]
    bins: tuple[int, int]
    mapping: tuple[int, ...]
    counts: Mapping[int, NDArray[np.int64]]

    def __post_init__(self) -> None:
        if len(self.extent) not in _LIMITS.values() or (len(self.extent) == 2 and self.bins[1] != 1):
            raise ValueError(f"{self.name}: ext {self.extent} with bins {self.bins}; expected 2 numbers (1D) or 4 (2D)")
        for taxel, counts in self.counts.items():
            if counts.shape != (*self.bins, 2):
                raise ValueError(f"{self.name} {taxel}: counts {counts.shape}; expected {(*self.bins, 2)}")


def read_taxels(file: Path) -> tuple[PartMap, ...]:
    """The maps of a taxels*.ini, one a body part; all it holds but its white space.

    InputError names the file, the line and the value, and what was expected.
    """
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected a taxels*.ini") from error
    sections: dict[str, tuple[int, dict[str, Entry]]] = {}
    entries: dict[str, Entry] | None = None
    for number, text in enumerate(lines, start=1):
        key, _, value = text.strip().replace("\t", " ").partition(" ")
        if not key:
            continue
        if key.startswith("["):
            name = text.strip().strip("[]").strip()
            if not name or name in sections:
                raise InputError(file, f"section {text.strip()}; expected each body part once, by its name", number)
            sections[name] = number, (entries := {})
        elif entries is None or key in entries or not (key in _KEYS or _is_whole(key)):
            expected = f"expected a [body part], then each of {', '.join(_KEYS)} and each taxel's number once"
            raise InputError(file, f"'{text.strip()[:40]}'; {expected}", number)
        else:
            entries[key] = (value.strip(), number)
    if not sections:
        raise InputError(file, "no section; expected one [body part] or more")
    return tuple(_part(file, name, *section) for name, section in sections.items())


def representatives(maps: Sequence[PartMap]) -> dict[str, tuple[int, ...]]:
    """By body part as it is called here, which virtual taxel each physical one belongs to, −1 none."""
    return {OUR_NAMES.get(part.name, part.name): part.mapping for part in maps}


def _part(file: Path, name: str, start: int, entries: dict[str, Entry]) -> PartMap:
    """The map that one section holds."""
    for key in _KEYS:
        if key not in entries:
            raise InputError(file, f"[{name}] has no {key}; expected {', '.join(_KEYS)}", start)
    modality, line = entries["modality"]
    if modality not in _LIMITS:
        raise InputError(file, f"modality {modality}; expected {' or '.join(_LIMITS)}", line)
    (size,) = _numbers(file, "size", entries["size"], int, 1)
    (n_taxels,) = _numbers(file, "nTaxels", entries["nTaxels"], int, 1)
    (extent,) = _lists(file, "ext", entries["ext"], float, _LIMITS[modality])
    (bins,) = _lists(file, "binsNum", entries["binsNum"], int, 2)
    (mapping,) = _lists(file, "Mapping", entries["Mapping"], int, size)
    if any(low >= high for low, high in zip(extent[::2], extent[1::2], strict=True)):
        raise InputError(file, f"ext {entries['ext'][0]}; expected ranges from low to high", entries["ext"][1])
    if min(bins) < 1 or (modality == "1D" and bins[1] != 1):
        raise InputError(
            file, f"binsNum {entries['binsNum'][0]}; expected bins, in 1D one of TTC", entries["binsNum"][1]
        )
    counts = {}
    for key in entries.keys() - set(_KEYS):
        both = _lists(file, f"taxel {key}", entries[key], int, bins[0] * bins[1], 2)
        if not 0 <= min(map(min, both)) <= max(map(max, both)) <= _LARGEST:
            raise InputError(file, f"taxel {key} has a count below 0 or past 2^63; expected neither", entries[key][1])
        counts[int(key)] = np.stack([np.array(one, np.int64).reshape(bins) for one in both], axis=-1)
    if len(counts) != n_taxels:
        raise InputError(file, f"nTaxels {n_taxels}; expected {len(counts)}, as many as follow", entries["nTaxels"][1])
    in_order = {taxel: counts[taxel] for taxel in (int(key) for key in entries if key not in _KEYS)}
    return PartMap(name, extent, (bins[0], bins[1]), mapping, in_order)


def _lists(
    file: Path, what: str, entry: Entry, kind: Callable[[str], Number], n: int, count: int = 1
) -> list[tuple[Number, ...]]:
    """The `count` lists "(a b …)" of an entry, of `n` numbers each."""
    text, line = entry
    lists = re.findall(r"\(([^()]*)\)", text)
    if len(lists) != count or re.sub(r"\([^()]*\)", "", text).strip():
        raise InputError(file, f"{what} {text[:40]}; expected {count} in brackets: {'(…) ' * count}".rstrip(), line)
    return [_numbers(file, what, (inside, line), kind, n) for inside in lists]


def _numbers(file: Path, what: str, entry: Entry, kind: Callable[[str], Number], n: int) -> tuple[Number, ...]:
    """The `n` finite numbers of a text."""
    text, line = entry
    found = []
    for word in text.split():
        try:
            found.append(kind(word))
        except ValueError as error:
            raise InputError(file, f"{what} {word}; expected numbers", line) from error
        if not abs(found[-1]) < float("inf"):
            raise InputError(file, f"{what} {word}; expected finite numbers", line)
    if len(found) != n:
        raise InputError(file, f"{what} has {len(found)} numbers; expected {n}", line)
    return tuple(found)


def _is_whole(word: str) -> bool:
    return word.isascii() and word.isdecimal()


def write_taxels(file: Path, parts: Sequence[PartMap]) -> None:
    """Write a taxels*.ini as the robot does; read again it is the same."""
    file.write_text("".join(_section(part) for part in parts))


def _section(part: PartMap) -> str:
    modality = next(name for name, n in _LIMITS.items() if n == len(part.extent))
    head = [
        f"[{part.name}]",
        f"modality\t{modality}",
        f"size    \t{len(part.mapping)}",
        f"nTaxels \t{len(part.counts)}",
        f"ext     \t({' '.join(repr(float(end)) for end in part.extent)})",
        f"binsNum \t({part.bins[0]}\t{part.bins[1]})",
        f"Mapping\t({_spaced(part.mapping)})",
    ]
    rows = [
        f"{taxel} ({_spaced(counts[..., 0].ravel())}) ({_spaced(counts[..., 1].ravel())})"
        for taxel, counts in part.counts.items()
    ]
    return "\n".join([*head, *rows, ""])


def _spaced(numbers: Sequence[int] | NDArray[np.int64]) -> str:
    return " ".join(str(int(number)) for number in numbers)
