"""`pps-vision convert-taxels`: our memory to the robot's own map of peripersonal space, and back."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from pps_vision.errors import InputError


@dataclass(frozen=True)
class ConvertTaxels:
    """Convert between our memory (.npz) and the robot's map (taxels*.ini); the suffixes give the direction.

    Counts, ranges, bins and taxels are converted exactly.  The .ini does not hold the width of the Parzen window: the
    robot has its own, and a memory read from it gets the paper's.  In both, D is the distance to the object's surface.
    """

    input: Positional[Path]
    """IN, .npz or .ini."""
    out: Positional[Path]
    """OUT, the other."""
    like: Path | None = None
    """To .ini: a map of the same robot, whose assignment of physical to virtual taxels is copied."""
    parts: tuple[str, ...] = ()
    """From .ini: only these body parts, such as l_forearm (default: all, which must have the same bins)."""
    own_skin: bool = False
    """From .ini: exactly the taxels of our skin, as `learn --into` expects them; others are left out, and taxels that
    are missing in the file stay empty."""

    def run(self) -> None:
        way = (self.input.suffix.lower(), self.out.suffix.lower())
        if way == (".npz", ".ini"):
            self._to_robot()
        elif way == (".ini", ".npz"):
            self._from_robot()
        else:
            raise InputError("convert-taxels", f"{self.input} {self.out}; expected a .npz and a .ini, in either order")

    def _to_robot(self) -> None:
        from learning.pps.memory import MemoryParams, load_memory
        from pps_vision.app.convert_taxels import to_maps
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.taxels_ini import read_taxels, write_taxels

        if self.like is None:
            raise InputError(self.input, "knows no physical taxels; expected --like TAXELS.ini, a map of this robot")
        if self.parts or self.own_skin:
            raise InputError("convert-taxels", "--parts, --own-skin; expected only where a .ini is converted")
        with whole_file(self.out, [self.input, self.like]) as partial:
            memory = load_memory(self.input)
            maps = to_maps(memory, read_taxels(self.like), self.input, self.like)
            write_taxels(partial, maps)
        n = sum(len(part.counts) for part in maps)
        print(f"{n} taxels on {', '.join(part.name for part in maps)} → {self.out}")
        if n < len(memory.taxel_ids):
            print(f"left out: {len(memory.taxel_ids) - n} untouched taxels that {self.like} does not know")
        paper = MemoryParams()
        if memory.params.sigma_bins != paper.sigma_bins:
            print(f"not carried: a window {memory.params.sigma_bins:g} bins wide; the robot's form has no place for it")

    def _from_robot(self) -> None:
        from learning.pps.memory import save_memory
        from pps_vision.app.convert_taxels import from_maps, onto
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.taxels_ini import read_taxels
        from pps_vision.robot.skin import icub_skin

        if self.like is not None:
            raise InputError("convert-taxels", "--like; expected only where a .npz is converted")
        with whole_file(self.out, [self.input]) as partial:
            maps = read_taxels(self.input)
            names = [part.name for part in maps]
            unknown = [name for name in self.parts if name not in names]
            if unknown:
                raise InputError(self.input, f"no {unknown[0]}; expected one of {', '.join(names)}")
            memory = from_maps([part for part in maps if not self.parts or part.name in self.parts], self.input)
            if self.own_skin:
                ids_of_file = memory.taxel_ids
                memory = onto(memory, icub_skin())
                common = len(set(ids_of_file) & set(memory.taxel_ids))
                print(
                    f"{common} of {len(ids_of_file)} taxels are on this skin, the others left out; "
                    f"{len(memory.taxel_ids) - common} of its stay empty"
                )
            save_memory(partial, memory)
        parts = dict.fromkeys(name.split(":")[0] for name in memory.taxel_ids)
        print(f"{len(memory.taxel_ids)} taxels on {', '.join(parts)} → {self.out}")
