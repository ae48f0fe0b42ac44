"""The log of the skin port: touched virtual taxels "part:id", or the robot's contacts.

A row is "index stamp touched touched …".  We write the touched virtual taxels by name.  The robot writes a contact as
((number, body part, link, skin part), centre of pressure, force, moment, geometric centre, normal, (taxels), pressure),
where vectors are in the link's frame and taxels are physical ones.
"""

from collections.abc import Mapping
from pathlib import Path

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.recording import Touch
from pps_vision.recordings.text import finite, whole
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.recordings.yarp_text import parse_lists, parse_numbers, read_log

Representatives = Mapping[str, tuple[int, ...]]
"""By body part: the virtual taxel of each physical one, −1 none."""

SKIN_PARTS = {1: "left_palm", 2: "left_forearm", 4: "right_palm", 5: "right_forearm"}
"""The robot's numbers of the skin parts that have virtual taxels here."""


def read_touches(log: Path, representatives: Representatives | None, problems: list[Problem]) -> tuple[Touch, ...]:
    """Return the touched virtual taxels by stamp; rows that cannot be read are added to `problems` and left out.

    Contacts on body parts that `representatives` does not name are left out; without `representatives` a log of
    contacts is noted and not read.  InputError where the log cannot be opened, or holds rows but no readable one.
    """
    rows = read_log(log, None, problems)
    if any(row.words[0].startswith("((") for row in rows if row.words):
        if representatives is None:
            reason = "the robot's contacts; expected --taxels TAXELS.ini, which says what virtual taxels they touch"
            problems.append(Problem(ProblemKind.TOUCHES, log, None, reason))
            return ()
        expected = "contacts ((4 whole numbers) (5 vectors of 3) (taxels) pressure)"
    else:
        representatives = None
        expected = "touched taxels as part:id"
    touches = []
    bad = []
    for row in rows:
        try:
            ids = _named_taxels(row.words) if representatives is None else _of_contacts(row.words, representatives)
            touches.append(Touch(row.stamp_s, ids))
        except ValueError as error:
            bad.append(Problem(ProblemKind.ROW, log, row.line, f"{first_line(error)}; expected {expected}"))
    if bad and not touches:
        raise InputError(log, f"{bad[0].message}; none of {len(bad)} rows can be read", bad[0].line)
    problems += bad
    return tuple(touches)


def _named_taxels(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the words if all are "part:id"."""
    for word in words:
        part, _, taxel = word.partition(":")
        if not (part.isidentifier() and taxel.isdecimal()):
            raise ValueError(f"'{word[:40]}'")
    return words


def _of_contacts(words: tuple[str, ...], representatives: Representatives) -> tuple[str, ...]:
    """Return the virtual taxels that the contacts of a row touch, each once."""
    touched = []
    for contact in parse_lists(" ".join(words)):
        if isinstance(contact, str) or len(contact) != 8 or not isinstance(contact[7], str):
            raise ValueError("no contact")
        ids, *vectors, taxels, pressure = contact
        for vector in vectors:
            parse_numbers(vector, finite, 3)
        finite(str(pressure))
        part = SKIN_PARTS.get(parse_numbers(ids, whole, 4)[3], "")
        of_part = representatives.get(part, ())
        virtual = [of_part[taxel] for taxel in parse_numbers(taxels, whole) if 0 <= taxel < len(of_part)]
        touched += [f"{part}:{taxel}" for taxel in virtual if taxel >= 0]
    return tuple(dict.fromkeys(touched))
