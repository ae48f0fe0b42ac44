"""YARP's two text forms: nested lists "a (b c) (d (e))", and configuration files of sections."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.text import finite, read_lines, whole

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

    def number(self) -> float:
        """Return the entry's one number; InputError if it is none or not finite."""
        try:
            return finite(self.text)
        except ValueError:
            raise self.error("a finite number") from None

    def whole(self) -> int:
        """Return the entry's one whole number; InputError if it is none."""
        try:
            return whole(self.text)
        except ValueError:
            raise self.error("a whole number") from None

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

    Comments (// or #) are left out.

    Raises:
        InputError: The file cannot be read (the message ends in `expected`), or a section, or a key within
            one, comes twice.
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
