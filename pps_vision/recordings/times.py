"""Files of stamps: `--times`, KITTI's times.txt and timestamps.txt, EuRoC's data.csv.

A row is a stamp, a stamp and the name of its image, or a count and a stamp; rows of words before the first stamp are a
header.  Stamps are numbers, digits since 1970, or dates.  The unit of numbers is what the header says, or what makes
the rate that of the video, or a usual one.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path, PurePath
from typing import TypeVar

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings import TimeUnit
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.text import finite, read_lines
from pps_vision.recordings.warnings import Problem, ProblemKind

FileT = TypeVar("FileT", bound=ImageFile)
_EXPECTED = "a stamp a row (s, ms, µs, ns with a decimal point, or a date), each later than the last"
_EXPONENTS: dict[TimeUnit, int] = {"s": 0, "ms": 3, "us": 6, "ns": 9}
_SINCE_1970: dict[int, TimeUnit] = {13: "ms", 16: "us", 19: "ns"}  # by the number of digits
_UNITS: dict[str, TimeUnit] = {"s": "s", "ms": "ms", "us": "us", "µs": "us", "ns": "ns"}
_UNITS |= {"milli": "ms", "micro": "us", "nano": "ns"}
_IN_HEADER = re.compile(
    r"(?:time|stamp|\bt)[a-z]*[\s_\[(]+(?:in[\s_]+)?(?:(ns|us|µs|ms|s)|(milli|micro|nano)s)(?:ec\w*)?\b", re.IGNORECASE
)
_DATE = re.compile(
    r"(?:([0-9]{4})-([0-9]{2})-([0-9]{2})[T ])?([0-9]{2}):([0-9]{2}):([0-9]{2})([.,][0-9]+)?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?(?![^\s,;])"
)
_USUAL_RATES = (1.0, 1000.0)  # frames per second
_POSSIBLE_RATE = 0.001  # slower ones are not asked about


@dataclass(frozen=True, slots=True)
class Times:
    """A file of stamps, in the order of its rows, in a unit that may not be known, and the names of their images, if
    given."""

    file: Path
    values: tuple[int | float, ...]
    names: tuple[str, ...]
    unit: TimeUnit | None

    def seconds(self, own_step_s: float = 0.0) -> tuple[float, ...]:
        """The stamps (s); `own_step_s`: usual interval of the frames by their video, 0 where there is none.

        InputError where several units, or none, make a usual rate.
        """
        unit = self.unit or self._unit_by_rate(own_step_s)
        return tuple(value / 10 ** _EXPONENTS[unit] for value in self.values)

    def stamp(self, files: list[FileT], problems: list[Problem], own_step_s: float = 0.0) -> list[FileT]:
        """The files with their stamps: by name, an image without a row being noted, or by place.

        InputError if the rows have no names and are not as many as the files.
        """
        stamps_s = self.seconds(own_step_s)
        if self.names:
            by_name = dict(zip(self.names, stamps_s, strict=True))
            problems += [
                Problem(ProblemKind.STAMP, file.path, None, f"has no row in {self.file}; expected its stamp there")
                for file in files
                if file.path.name not in by_name
            ]
            return [replace(file, stamp_s=by_name[file.path.name]) for file in files if file.path.name in by_name]
        if len(files) != len(stamps_s):
            where = f"{files[0].path.parent}" if files and type(files[0]) is ImageFile else "the video"
            reason = f"{len(stamps_s)} stamps for {len(files)} images of {where}"
            other = "rows of stamp and name, or a file for each side: --times LEFT RIGHT"
            raise InputError(self.file, f"{reason}; expected one for each, {other}")
        return [replace(file, stamp_s=stamp_s) for file, stamp_s in zip(files, stamps_s, strict=True)]

    def _unit_by_rate(self, own_step_s: float) -> TimeUnit:
        step = float(np.median(np.diff(np.array(self.values, float)))) if len(self.values) > 1 else 0.0
        if step <= 0:
            return "s"
        rates = {unit: 10**exponent / step for unit, exponent in _EXPONENTS.items()}
        if own_step_s > 0:  # units are 1000 apart: one is nearest
            return min(rates, key=lambda unit: abs(np.log(rates[unit] * own_step_s)))
        low, high = _USUAL_RATES
        near = [unit for unit, rate in rates.items() if _POSSIBLE_RATE <= rate < high]
        if len(near) == 1 and rates[near[0]] >= low:
            return near[0]
        listed = ", ".join(f"{rates[unit]:.3g} in {unit}" for unit in near or rates)
        raise InputError(
            self.file, f"its stamps a second are {listed}; expected --times-unit {' or '.join(near or rates)}"
        )


def read_times(file: Path, unit: TimeUnit | None = None) -> Times:
    """Read the stamps; `unit`: theirs.  InputError for a row that is none, or is not later than the one before."""
    rows: list[tuple[int, list[str]]] = []  # line and words
    header = ""
    for line, text in enumerate(read_lines(file, _EXPECTED), start=1):
        content, _, comment = text.replace('"', "").partition("#")
        if not rows and not re.match(r"\s*[-+.0-9]|\s*(nan|inf)\b", content, re.IGNORECASE):
            header += f" {content.strip()} {comment.strip()}"
        elif content.strip():
            date = _DATE.match(content.strip())
            rest = content.strip()[date.end() if date else 0 :].strip(" \t,;")
            rows.append((line, [*([date[0]] if date else []), *(re.split(r"[\s,;]+", rest) if rest else [])]))
    column = _column([words for _, words in rows], header)
    values: list[int | float] = []
    names: dict[str, None] = {}
    for line, words in rows:
        try:
            word, *name = words[column:] if column == 0 or _is_number(words[0]) else (words[1], words[0])
            value = _number(word)
        except (ValueError, IndexError) as error:
            raise InputError(file, f"{error}; expected {_EXPECTED}", line) from None
        if values and value <= values[-1]:
            raise InputError(file, f"{word} after {values[-1]}; expected {_EXPECTED}", line)
        if name and PurePath(name[0]).name in names:
            raise InputError(file, f"image {name[0]} again; expected {_EXPECTED}, and each image once", line)
        values.append(value)
        names |= {PurePath(word).name: None for word in name[:1]}
    if not values or (names and len(names) != len(values)):
        reason = f"{len(values)} stamps, {len(names)} names"
        raise InputError(file, f"{reason}; expected {_EXPECTED}, all with a name or none")
    if unit is None:
        stated = _IN_HEADER.search(header)
        unit = _UNITS[(stated[1] or stated[2]).lower()] if stated else _unit_of(values, rows[0][1][column])
    return Times(file, tuple(values), tuple(names), unit)


def _column(rows: Sequence[list[str]], header: str) -> int:
    """The column of the stamps: that of a header's time or stamp, or the second where the first counts the rows."""
    cells = re.split(r"[,;\t]", header)
    named = [k for k, cell in enumerate(cells) if re.search("time|stamp", cell, re.IGNORECASE)]
    if len(cells) > 1 and named:
        return named[0]
    if not (len(rows) > 1 and all(len(words) > 1 and _is_number(words[0]) and _is_number(words[1]) for words in rows)):
        return 0
    return int(np.all(np.diff([float(words[0]) for words in rows]) == 1))


def _unit_of(values: Sequence[int | float], word: str) -> TimeUnit | None:
    """The unit of a date, or of digits since 1970, unless these would be years."""
    if _DATE.match(word):
        return "s"
    unit = _SINCE_1970.get(len(word)) if isinstance(values[0], int) else None
    step = (values[-1] - values[0]) / max(len(values) - 1, 1)
    return unit if unit and step < 10 ** _EXPONENTS[unit] / _POSSIBLE_RATE else None


def _is_number(word: str) -> bool:
    try:
        finite(word)
    except ValueError:
        return False
    return True


def _number(word: str) -> int | float:
    """The number that a word spells, or a date's seconds since 1970, or of the day."""
    if date := _DATE.fullmatch(word):
        year, month, day, hour, minute, second, fraction, zone = date.groups()
        numbers = (int(year or 1970), int(month or 1), int(day or 1), int(hour), int(minute), int(second))
        moment = datetime(*numbers, tzinfo=UTC)
        if zone and zone != "Z":
            moment -= (1 if zone[0] == "+" else -1) * timedelta(hours=int(zone[1:3]), minutes=int(zone[-2:]))
        return moment.timestamp() + float(f"0.{(fraction or '.0')[1:]}")
    return int(word) if word.isascii() and word.isdecimal() and len(word) < 20 else finite(word)
