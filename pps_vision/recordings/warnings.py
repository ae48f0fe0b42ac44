"""How bad input is reported: fatally in one line, or as a problem that is skipped and counted."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from pps_vision.errors import cite


class ProblemKind(StrEnum):
    """Kinds of skipped input: keys of the counts in summary.json."""

    IMAGE = "bad_image"
    ROW = "bad_row"
    STAMP = "backwards_stamp"
    JOINTS = "bad_joints"
    UNPAIRED = "unpaired_frame"
    TOUCHES = "unknown_touches"


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing, or several in a row, that was skipped while the rest was read: which file and line, and why."""

    kind: ProblemKind
    file: Path
    line: int | None
    message: str
    count: int = 1  # how many were skipped, the first of which is named

    def __str__(self) -> str:
        return cite(self.file, self.line, self.message)


def count_by_kind(problems: Iterable[Problem]) -> dict[str, int]:
    """How many things were skipped of every kind, zeros included."""
    counts = Counter[ProblemKind]()
    for problem in problems:
        counts[problem.kind] += problem.count
    return {kind.value: counts[kind] for kind in ProblemKind}
