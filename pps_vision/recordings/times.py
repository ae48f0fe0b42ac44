"""A file of stamps: one a row in seconds, "stamp name" as TUM writes it, or EuRoC's CSV in nanoseconds."""

import re
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

from pps_vision.errors import InputError
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.recording import FileT
from pps_vision.recordings.text import finite, read_lines
from pps_vision.recordings.warnings import Problem, ProblemKind

_EXPECTED = "a stamp a row, in s or digits of ms, µs or ns since 1970, each later than the last"


@dataclass(frozen=True, slots=True)
class Times:
    """Stamps in the order of their rows, and the names of their images, if given."""

    file: Path
    stamps_s: tuple[float, ...]
    names: tuple[str, ...]

    def stamp(self, files: list[FileT], problems: list[Problem]) -> list[FileT]:
        """The files with their stamps: by name, an image without a row being noted, or by place.

        InputError if the rows have no names and are not as many as the files.
        """
        if self.names:
            by_name = dict(zip(self.names, self.stamps_s, strict=True))
            problems += [
                Problem(ProblemKind.STAMP, file.path, None, f"has no row in {self.file}; expected its stamp there")
                for file in files
                if file.path.name not in by_name
            ]
            return [replace(file, stamp_s=by_name[file.path.name]) for file in files if file.path.name in by_name]
        if len(files) != len(self.stamps_s):
            where = f"{files[0].path.parent}" if files and type(files[0]) is ImageFile else "the video"
            reason = f"{len(self.stamps_s)} stamps for {len(files)} images of {where}"
            raise InputError(self.file, f"{reason}; expected one for each, or rows of stamp and name")
        return [replace(file, stamp_s=stamp_s) for file, stamp_s in zip(files, self.stamps_s, strict=True)]


def read_times(file: Path) -> Times:
    """Read the stamps; InputError for a row that is none, or is not later than the one before."""
    stamps: list[float] = []
    names: list[str] = []
    for line, row in enumerate(read_lines(file, _EXPECTED), start=1):
        words = re.split(r"[\s,]+", row.partition("#")[0].strip())
        if words == [""]:
            continue
        try:
            stamp_s = _seconds(words[0])
        except ValueError as error:
            raise InputError(file, f"{error}; expected {_EXPECTED}", line) from None
        if stamps and stamp_s <= stamps[-1]:
            raise InputError(file, f"{words[0]} after {stamps[-1]} s; expected {_EXPECTED}", line)
        stamps.append(stamp_s)
        names += [PurePath(word).name for word in words[1:2]]
    if not stamps or (names and len(names) != len(stamps)):
        raise InputError(
            file, f"{len(stamps)} stamps, {len(names)} names; expected {_EXPECTED}, all with a name or none"
        )
    return Times(file, tuple(stamps), tuple(names))


def _seconds(word: str) -> float:
    if word.isascii() and word.isdecimal() and len(word) in (13, 16, 19):
        return int(word) / 10 ** (len(word) - 10)
    return finite(word)
