"""`pps-vision convert-taxels`: our memory to the robot's own map of peripersonal space, and back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from learning.memory import MemoryParams, PPSMemory, load_memory, save_memory
from pps_vision.errors import InputError
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.taxels_ini import OUR_NAMES, PartMap, read_taxels, write_taxels
from pps_vision.robot.skin import Skin, icub_skin

_ROBOTS_NAME = {ours: theirs for theirs, ours in OUR_NAMES.items()}


@dataclass(frozen=True)
class ConvertTaxels:
    """Convert between our memory (.npz) and the robot's map (taxels*.ini); the suffixes say which way.

    Counts, ranges, bins and taxels are carried exactly.  The .ini has no place for the width of the Parzen
    window and for forgetting: the robot has its own, and a memory read from it gets the paper's.  The robot
    takes D to the surface of what it tracks, not to its centre (ReceptiveField.subtract_radius here).
    """

    input: tyro.conf.Positional[Path]
    """IN, .npz or .ini."""
    out: tyro.conf.Positional[Path]
    """OUT, the other."""
    like: Path | None = None
    """To .ini: a map of the same robot, whose assignment of physical to virtual taxels is taken over."""
    parts: tuple[str, ...] = ()
    """From .ini: only these body parts, such as l_forearm (default: all, which must have the same bins)."""
    own_skin: bool = False
    """From .ini: exactly the taxels of the skin here, as `learn --into` wants them; others are left out, and
    those the file does not know stay empty."""

    def run(self) -> None:
        """Convert and say what was carried."""
        way = (self.input.suffix.lower(), self.out.suffix.lower())
        if way == (".npz", ".ini"):
            self._to_robot()
        elif way == (".ini", ".npz"):
            self._from_robot()
        else:
            raise ValueError(f"convert-taxels {self.input} {self.out}: expected a .npz and a .ini, in either order")

    def _to_robot(self) -> None:
        if self.like is None:
            raise ValueError(f"{self.input}: knows no physical taxels; expected --like TAXELS.ini, a map of this robot")
        if self.parts or self.own_skin:
            raise ValueError("--parts, --own-skin: expected only where a .ini is converted")
        memory = load_memory(self.input)
        maps = to_maps(memory, read_taxels(self.like), self.input, self.like)
        with whole_file(self.out) as partial:
            write_taxels(partial, maps)
        print(f"{len(memory.taxel_ids)} taxels on {', '.join(part.name for part in maps)} → {self.out}")
        paper = MemoryParams()
        for name, mine, usual in (
            ("a window", f"{memory.params.sigma_bins:g} bins wide", f"{paper.sigma_bins:g} bins wide"),
            (
                "a half life",
                f"of {memory.params.half_life_touches:g} touches",
                f"of {paper.half_life_touches:g} touches",
            ),
        ):
            if mine != usual:
                print(f"not carried: {name} {mine}; the robot's form has no place for it")

    def _from_robot(self) -> None:
        if self.like is not None:
            raise ValueError("--like: expected only where a .npz is converted")
        maps = read_taxels(self.input)
        unknown = [name for name in self.parts if name not in {part.name for part in maps}]
        if unknown:
            raise InputError(self.input, f"no {unknown[0]}; expected one of {', '.join(part.name for part in maps)}")
        memory = from_maps([part for part in maps if not self.parts or part.name in self.parts], self.input)
        if self.own_skin:
            found, memory = memory.taxel_ids, onto(memory, icub_skin())
            common = len(set(found) & set(memory.taxel_ids))
            print(
                f"{common} of {len(found)} taxels are on this skin, the others left out; "
                f"{len(memory.taxel_ids) - common} of its stay empty"
            )
        with whole_file(self.out) as partial:
            save_memory(partial, memory)
        names = memory.taxel_ids
        print(f"{len(names)} taxels on {', '.join(dict.fromkeys(name.split(':')[0] for name in names))} → {self.out}")


def from_maps(maps: Sequence[PartMap], file: Path) -> PPSMemory:
    """The memory of a robot's maps, taxels named "part:id"; InputError if parts differ in ranges or bins."""
    first = maps[0]
    for part in maps:
        if (part.extent, part.bins) != (first.extent, first.bins):
            forms = (f"{p.name} has ext {p.extent}, bins {p.bins}" for p in (first, part))
            raise InputError(file, f"{', '.join(forms)}; expected one form for a memory: choose with --parts")
    low, high, *ttc = first.extent
    ttc_range = (ttc[0], ttc[1]) if ttc else (-np.inf, np.inf)
    return PPSMemory(
        tuple(f"{OUR_NAMES.get(part.name, part.name)}:{taxel}" for part in maps for taxel in part.counts),
        np.repeat(np.arange(len(maps)), [len(part.counts) for part in maps]),
        np.array([counts for part in maps for counts in part.counts.values()]).reshape(-1, *first.bins, 2),
        MemoryParams((low, high), ttc_range, first.bins),
    )


def onto(memory: PPSMemory, skin: Skin) -> PPSMemory:
    """The memory for exactly the taxels of a skin: what is new is empty, what is not on it left out."""
    blank = PPSMemory.empty(skin, memory.params)
    at = {name: i for i, name in enumerate(memory.taxel_ids)}
    counts = blank.counts.astype(memory.counts.dtype)
    for i, name in enumerate(skin.taxel_ids):
        if name in at:
            counts[i] = memory.counts[at[name]]
    return replace(blank, counts=counts)


def to_maps(memory: PPSMemory, like: Sequence[PartMap], source: Path, model: Path) -> tuple[PartMap, ...]:
    """The robot's maps of a memory, physical taxels assigned as in `like`; InputError for what the form cannot hold."""
    if not np.array_equal(memory.counts, np.round(memory.counts)):
        raise InputError(
            source, "has fractions of samples, since it forgets; expected whole numbers, which the .ini holds"
        )
    params = memory.params
    knows_ttc = np.all(np.isfinite(params.ttc_range_s))
    extent = (*params.distance_range_m, *(params.ttc_range_s if knows_ttc else ()))
    if not np.all(np.isfinite(extent)) or not (knows_ttc or params.ttc_range_s == (-np.inf, np.inf)):
        found = f"ranges D {params.distance_range_m} m, TTC {params.ttc_range_s} s"
        raise InputError(source, f"{found}; expected finite ones, or all TTC in one bin, which the .ini can hold")
    theirs = {part.name: part for part in like}
    taken: dict[str, dict[int, int]] = {}
    for i, name in enumerate(memory.taxel_ids):
        ours, _, taxel = name.rpartition(":")
        part = _ROBOTS_NAME.get(ours, ours)
        if part not in theirs:
            raise InputError(
                model, f"has no {part}, on which taxel {name} is; expected a map with all parts of {source}"
            )
        if not taxel.isdecimal() or int(taxel) not in theirs[part].mapping:
            raise InputError(model, f"[{part}] knows no taxel {taxel}; expected a Mapping with all taxels of {source}")
        taken.setdefault(part, {})[int(taxel)] = i
    counts = memory.counts.astype(np.int64)
    return tuple(
        PartMap(part, extent, params.bins, theirs[part].mapping, {taxel: counts[i] for taxel, i in rows.items()})
        for part, rows in taken.items()
    )
