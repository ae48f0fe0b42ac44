"""Our memory to the robot's own map of peripersonal space, and back."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory
from pps_vision.errors import InputError, first_line
from pps_vision.recordings.taxels_ini import OUR_NAMES, PartMap
from pps_vision.robot.skin import Skin

_ROBOTS_NAME = {ours: theirs for theirs, ours in OUR_NAMES.items()}


def from_maps(maps: Sequence[PartMap], file: Path) -> PPSMemory:
    """The memory of a robot's maps, taxels named "part:id"; InputError if parts differ in ranges or bins."""
    first = maps[0]
    for part in maps:
        if (part.extent, part.bins) != (first.extent, first.bins):
            forms = (f"{p.name} has ext {p.extent}, bins {p.bins}" for p in (first, part))
            raise InputError(file, f"{', '.join(forms)}; expected one form for a memory: choose with --parts")
    low, high, *ttc = first.extent
    ttc_range = (ttc[0], ttc[1]) if ttc else (-np.inf, np.inf)
    try:
        return PPSMemory(
            tuple(f"{OUR_NAMES.get(part.name, part.name)}:{taxel}" for part in maps for taxel in part.counts),
            np.repeat(np.arange(len(maps)), [len(part.counts) for part in maps]),
            np.array([counts for part in maps for counts in part.counts.values()]).reshape(-1, *first.bins, 2),
            MemoryParams((low, high), ttc_range, first.bins),
        )
    except ValueError as error:  # a range that is too narrow, or a part under both its names
        raise InputError(file, first_line(error)) from error


def onto(memory: PPSMemory, skin: Skin) -> PPSMemory:
    """The memory restricted and extended to the taxels of a skin; new taxels are empty."""
    blank = PPSMemory.empty(skin, memory.params)
    by_name = dict(zip(memory.taxel_ids, memory.counts, strict=True))
    counts = blank.counts.astype(memory.counts.dtype)
    for i, name in enumerate(skin.taxel_ids):
        counts[i] = by_name.get(name, counts[i])
    return replace(blank, counts=counts)


def to_maps(memory: PPSMemory, like: Sequence[PartMap], source: Path, model: Path) -> tuple[PartMap, ...]:
    """The robot's maps of a memory, physical taxels assigned as in `like`, without untouched taxels that `like` lacks.

    They hold the counts by D and TTC; the predicted miss distance has no place in them.

    InputError if the form cannot hold the memory, or a taxel that was learned is not in `like`.
    """
    if not np.array_equal(memory.counts, np.round(memory.counts)):
        raise InputError(source, "has fractions of samples; expected whole numbers, which the .ini holds")
    params = memory.params
    knows_ttc = np.all(np.isfinite(params.ttc_range_s))
    extent = (*params.distance_range_m, *(params.ttc_range_s if knows_ttc else ()))
    if not np.all(np.isfinite(extent)) or not (knows_ttc or params.ttc_range_s == (-np.inf, np.inf)):
        ranges = f"ranges D {params.distance_range_m} m, TTC {params.ttc_range_s} s"
        raise InputError(source, f"{ranges}; expected finite ones, or all TTC in one bin, which the .ini can hold")
    theirs = {part.name: part for part in like}
    taken: dict[str, dict[int, int]] = {}
    for i, name in enumerate(memory.taxel_ids):
        ours, _, taxel = name.rpartition(":")
        part = _ROBOTS_NAME.get(ours, ours)
        if part in theirs and taxel.isdecimal() and int(taxel) in theirs[part].mapping:
            taken.setdefault(part, {})[int(taxel)] = i
        elif memory.counts[i].any():
            lack = f"[{part}] knows no taxel {taxel}" if part in theirs else f"has no {part}, on which taxel {name} is"
            raise InputError(model, f"{lack}; expected a map with all taxels that {source} has learned")
    if not taken:
        raise InputError(model, f"has none of the taxels of {source}; expected a map of the same robot")
    bins = params.bins[0], params.bins[1]
    counts = memory.counts.reshape(len(memory.counts), *bins, -1, 2).sum(axis=3).astype(np.int64)  # of any path
    return tuple(
        PartMap(part, extent, bins, theirs[part].mapping, {taxel: counts[i] for taxel, i in rows.items()})
        for part, rows in taken.items()
    )
