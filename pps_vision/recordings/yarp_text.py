"""YARP's text forms: nested lists "a (b c) (d (e))", configuration files of sections, and logs.

The data.log of a yarpdatadumper port has a row "index stamp payload" a line.  With both times in a row the sender's
stamp comes before the receiver's; the sender's is used.
"""

import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.text import number, read_lines, whole
from pps_vision.recordings.warnings import Problem, ProblemKind

STAMP_LIMIT_S = 1e12  # beyond any clock; keeps differences of stamps finite
Nested = list["str | Nested"]
Number = TypeVar("Number", int, float)


def parse_lists(text: str) -> Nested:
    """Return words and bracketed lists of them as nested lists; ValueError where brackets do not match."""
    stack: list[Nested] = [[]]
    for word in re.findall(r"[()]|[^()\s]+", text):
        if word == "(":
            stack.append([])
        elif word == ")":
            if len(stack) == 1:
                raise ValueError("a bracket closes that none opened")
            finished = stack.pop()
            stack[-1].append(finished)
        else:
            stack[-1].append(word)
    if len(stack) > 1:
        raise ValueError("a bracket is not closed")
    return stack[0]


def parse_numbers(group: str | Nested, kind: Callable[[str], Number], n: int | None = None) -> tuple[Number, ...]:
    """Return the `n` numbers of a list; ValueError if it holds another count of them (None: any), or no numbers."""
    if isinstance(group, str):
        raise ValueError(f"'{group[:40]}' is no list of numbers")
    words = [word for word in group if isinstance(word, str)]
    if len(words) != len(group):
        raise ValueError("a list in a list of numbers")
    if n is not None and len(words) != n:
        raise ValueError(f"{len(words)} numbers; expected {n}")
    return tuple(kind(word) for word in words)


@dataclass(frozen=True, slots=True)
class Entry:
    """One key of a configuration file with the text after it."""

    file: Path
    line: int
    key: str
    text: str

    def error(self, expected: str) -> InputError:
        """Return the refusal of this entry."""
        return InputError(self.file, f"{self.key} {self.text[:40]}; expected {expected}", self.line)

    def number(self, kind: Callable[[str], Number]) -> Number:
        """Return the entry's one number, `finite` or `whole`; InputError if it is none."""
        try:
            return kind(self.text)
        except ValueError:
            raise self.error("a whole number" if kind is whole else "a finite number") from None

    def lists(self, kind: Callable[[str], Number], n: int, count: int = 1) -> list[tuple[Number, ...]]:
        """Return the entry's `count` lists of `n` numbers each; InputError if it holds anything else."""
        try:
            groups = parse_lists(self.text)
            if len(groups) != count:
                raise ValueError(f"{len(groups)} lists")
            return [parse_numbers(group, kind, n) for group in groups]
        except ValueError as error:
            raise self.error(f"{count} × ({n} numbers), found {first_line(error)}") from None


@dataclass(frozen=True, slots=True)
class Section:
    """One [section] of a configuration file, and the line that it starts in."""

    file: Path
    line: int
    name: str
    entries: dict[str, Entry]

    def required(self, keys: Sequence[str]) -> list[Entry]:
        """Return the entries of these keys; InputError if one is missing."""
        for key in keys:
            if key not in self.entries:
                raise InputError(self.file, f"[{self.name}] has no {key}; expected {', '.join(keys)}", self.line)
        return [self.entries[key] for key in keys]


def read_sections(file: Path, expected: str) -> dict[str, Section]:
    """Return the sections of a configuration file by name; keys before the first one are in the section "".

    Comments (// or #) are left out.  InputError where the file cannot be read (the message ends in `expected`), or a
    section, or a key within one, comes twice.
    """
    section = Section(file, 1, "", {})
    sections = {"": section}
    for line, text in enumerate(read_lines(file, expected), start=1):
        key, _, value = " ".join(re.split(r"//|#", text, maxsplit=1)[0].split()).partition(" ")
        if key.startswith("["):
            name = f"{key} {value}".strip("[] ")
            if name in sections:
                raise InputError(file, f"section [{name}]; expected each section once, by its name", line)
            sections[name] = section = Section(file, line, name, {})
        elif key:
            if key in section.entries:
                raise InputError(file, f"{key} {value[:40]}; expected each key once in [{section.name}]", line)
            section.entries[key] = Entry(file, line, key, value)
    return sections


@dataclass(frozen=True, slots=True)
class LogRow:
    """One readable row: its line in the file (from 1), its stamp, and the words after the stamps."""

    line: int
    stamp_s: float
    words: tuple[str, ...]


def read_log(log: Path, n_numbers: int | None, problems: list[Problem], distinct_stamps: bool = False) -> list[LogRow]:
    """The readable rows of a log in the order of their stamps.

    `n_numbers` is the count of numbers a payload has; None where it begins with a word.  A row
    that cannot be read or whose stamp goes backwards (or, with `distinct_stamps`, comes again) is
    noted and skipped.  InputError if the log cannot be opened, or holds rows but no readable one.
    """
    expected = "index, stamp and " + ("words" if n_numbers is None else f"{n_numbers} numbers")
    rows = []
    bad = []
    stamps: list[tuple[float, float]] = []  # of rows that seem to have two
    for line, text in enumerate(read_lines(log, f"rows of {expected}"), start=1):
        words = text.split()
        row = _parse(line, words, n_numbers) if words else None
        if row is not None:
            rows.append(row)
            if n_numbers and len(words) == n_numbers + 3:
                stamps.append((row.stamp_s, float(words[2])))
        elif words:
            bad.append(Problem(ProblemKind.ROW, log, line, f"'{' '.join(words)[:60]}'; expected {expected}"))
    if bad and not rows:
        raise InputError(log, f"{bad[0].message}; none of {len(bad)} rows can be read", bad[0].line)
    step_s, other_s = np.median(np.diff(stamps, axis=0), axis=0) if len(stamps) > 1 else (0.0, 0.0)
    if not 0.5 * step_s <= other_s <= 2 * step_s:
        raise InputError(log, f"one number too many, which is no second stamp; expected {expected}", rows[0].line)
    problems += bad
    return _in_order(log, rows, problems, distinct_stamps)


def _parse(line: int, words: list[str], n_numbers: int | None) -> LogRow | None:
    """The row, or None if it has not the form of one."""
    numbers = [_number_or_none(word) for word in words]
    begin = len(words) - n_numbers if n_numbers is not None else (*numbers, None).index(None)
    head = numbers[: max(begin, 0)]
    payload = numbers[max(begin, 0) :]
    if len(head) not in (2, 3) or any(value is None or not abs(value) < STAMP_LIMIT_S for value in head):
        return None
    if n_numbers is not None and None in payload:
        return None
    return LogRow(line, float(words[1]), tuple(words[begin:]))


def _number_or_none(word: str) -> float | None:
    """The number a word spells, NaN and infinity included; None if it is none."""
    try:
        return number(word)
    except ValueError:
        return None


def _in_order(log: Path, rows: list[LogRow], problems: list[Problem], distinct_stamps: bool) -> list[LogRow]:
    """The most rows whose stamps do not decrease (or do increase), the others noted.

    The longest such subsequence, not a running maximum: one stamp that jumps ahead must not
    discard all the rows behind it.  Found from the end, so that of two rows which contradict
    each other the earlier is kept.
    """
    bisect, rule = (bisect_left, "increase") if distinct_stamps else (bisect_right, "never go backwards")
    best_ends: list[float] = []  # −stamp at the end of the best run of every length
    at: list[int] = []  # the row that is there
    previous = [-1] * len(rows)
    for i in range(len(rows) - 1, -1, -1):
        length = bisect(best_ends, -rows[i].stamp_s)
        previous[i] = at[length - 1] if length else -1
        best_ends[length : length + 1] = [-rows[i].stamp_s]
        at[length : length + 1] = [i]
    chain = []
    i = at[-1] if at else -1
    while i >= 0:
        chain.append(rows[i])
        i = previous[i]
    lines = {row.line for row in chain}
    problems += [
        Problem(ProblemKind.STAMP, log, row.line, f"stamp {row.stamp_s} s; expected stamps that {rule}")
        for row in rows
        if row.line not in lines
    ]
    return chain
