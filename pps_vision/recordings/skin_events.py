"""Logs of the robot's skin events: the contacts its skin feels at every stamp, as a yarpdatadumper writes them.

A row is "index stamp contact contact …"; a contact is (number, body part, link, skin part), then in the link's
frame the centre of pressure, force, moment, geometric centre and normal, then the touched taxels and the pressure.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.recordings.recording import Touch

Vector = tuple[float, float, float]
Nested = list["str | Nested"]

SKIN_PARTS = {1: "left_palm", 2: "left_forearm", 4: "right_palm", 5: "right_forearm"}
"""The robot's numbers of the skin parts that have virtual taxels here."""
_CONTACT = re.compile(r"\(\(\s*\d+(\s+\d+){3}\s*\)")
_EXPECTED = "index, stamp and contacts ((4 whole numbers) (5 vectors of 3) (taxels) pressure)"


@dataclass(frozen=True, slots=True)
class SkinContact:
    """One contact; positions m, forces N, moments Nm in the frame of the link; pressure in the skin's units."""

    number: int
    body_part: int
    link: int
    skin_part: int
    center_of_pressure: Vector
    force: Vector
    moment: Vector
    geometric_center: Vector
    normal: Vector
    taxels: tuple[int, ...]
    pressure: float


@dataclass(frozen=True, slots=True)
class SkinEvent:
    """What the skin feels at a stamp; no contact means that nothing touches it."""

    index: int
    stamp_s: float
    contacts: tuple[SkinContact, ...]


def holds_contacts(log: Path) -> bool:
    """Whether a skin log has the robot's contacts in it, not the touched taxels themselves."""
    try:
        return _CONTACT.search(log.read_text(errors="replace")) is not None
    except OSError:  # whoever reads it says so
        return False


def read_skin_events(log: Path, problems: list[Problem]) -> tuple[SkinEvent, ...]:
    """The events of a log in its order; a row that cannot be read is noted with its line and skipped.

    InputError if the log cannot be opened, or holds rows but no readable one.
    """
    try:
        lines = log.read_text(errors="replace").splitlines()
    except OSError as error:
        raise InputError(log, f"cannot be read: {first_line(error)}; expected rows of {_EXPECTED}") from error
    events, bad = [], []
    for line, text in enumerate(lines, start=1):
        try:
            if text.strip():
                events.append(_event(text))
        except (ValueError, IndexError) as error:
            found = f"'{' '.join(text.split())[:60]}' ({first_line(error)}); expected {_EXPECTED}"
            bad.append(Problem(ProblemKind.ROW, log, line, found))
    if bad and not events:
        raise InputError(log, f"{bad[0].message}; none of {len(bad)} rows can be read", bad[0].line)
    problems += bad
    return tuple(events)


def _event(text: str) -> SkinEvent:
    index, stamp, *contacts = _nested(text)
    if not isinstance(index, str) or not isinstance(stamp, str):
        raise ValueError("no index and stamp")
    return SkinEvent(int(index), _finite(stamp), tuple(_contact(contact) for contact in contacts))


def _contact(contact: "str | Nested") -> SkinContact:
    if isinstance(contact, str) or len(contact) != 8:
        raise ValueError(f"'{contact}' is no contact")
    number, body_part, link, skin_part = (int(word) for word in _words(contact[0]))
    pressure, force, moment, center, normal = (_vector(_words(vector)) for vector in contact[1:6])
    taxels = tuple(int(word) for word in _words(contact[6]))
    if not isinstance(contact[7], str):
        raise ValueError("no pressure")
    return SkinContact(
        *(number, body_part, link, skin_part, pressure, force, moment, center, normal, taxels, _finite(contact[7]))
    )


def _words(group: "str | Nested") -> list[str]:
    words = [] if isinstance(group, str) else [word for word in group if isinstance(word, str)]
    if len(words) != len(group) or isinstance(group, str):
        raise ValueError(f"'{group}' is no list of numbers")
    return words


def _vector(words: list[str]) -> Vector:
    x, y, z = (_finite(word) for word in words)
    return x, y, z


def _finite(word: str) -> float:
    number = float(word)
    if not abs(number) < float("inf"):
        raise ValueError(f"{word} is not finite")
    return number


def _nested(text: str) -> Nested:
    """Words and bracketed lists of them, as nested lists; ValueError where brackets do not match."""
    stack: list[Nested] = [[]]
    for word in re.findall(r"[()]|[^()\s]+", text):
        if word == "(":
            stack.append([])
        elif word == ")":
            if len(stack) == 1:
                raise ValueError("a bracket closes that none opened")
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(word)
    if len(stack) > 1:
        raise ValueError("a bracket is not closed")
    return stack[0]


def write_skin_events(log: Path, events: Iterable[SkinEvent]) -> None:
    """Write a log; read again it is the same."""
    log.write_text("".join(f"{e.index} {_stamp(e.stamp_s)} {' '.join(map(_text, e.contacts))}\n" for e in events))


def _stamp(stamp_s: float) -> str:
    """In microseconds as the robot writes it, with all digits where that is not enough."""
    usual = f"{stamp_s:.6f}"
    return usual if float(usual) == stamp_s else repr(stamp_s)


def _text(contact: SkinContact) -> str:
    ids = (contact.number, contact.body_part, contact.link, contact.skin_part)
    vectors = (contact.center_of_pressure, contact.force, contact.moment, contact.geometric_center, contact.normal)
    words = [map(str, ids), *(map(_decimal, vector) for vector in vectors), map(str, contact.taxels)]
    lists = [f"({' '.join(numbers)})" for numbers in words]
    return f"({' '.join(lists)} {_decimal(contact.pressure)})"


def _decimal(number: float) -> str:
    """All digits, never with an exponent, as the robot writes it."""
    return str(np.format_float_positional(number, trim="0"))


def touches_of(events: Iterable[SkinEvent], mapping: Mapping[str, tuple[int, ...]]) -> tuple[Touch, ...]:
    """The virtual taxels "part:id" touched at every stamp.

    `mapping` by body part (`left_forearm` …) says which virtual taxel each physical one belongs to, −1 none, as
    skin position files and taxels*.ini have it; parts it does not name are not felt.
    """
    return tuple(Touch(event.stamp_s, _virtual(event, mapping)) for event in events)


def _virtual(event: SkinEvent, mapping: Mapping[str, tuple[int, ...]]) -> tuple[str, ...]:
    touched = []
    for contact in event.contacts:
        part = SKIN_PARTS.get(contact.skin_part, "")
        of_part = mapping.get(part, ())
        representatives = [of_part[taxel] for taxel in contact.taxels if 0 <= taxel < len(of_part)]
        touched += [f"{part}:{taxel}" for taxel in representatives if taxel >= 0]
    return tuple(dict.fromkeys(touched))
