"""How bad input is reported: fatally in one line, or as a problem that is skipped and counted."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class BadInput(ValueError):
    """Input that nothing can be made of: "FILE:LINE: what was found; what was expected", one line."""

    def __init__(self, file: Path | str, message: str, line: int | None = None) -> None:
        super().__init__(file, message, line)

    def __str__(self) -> str:
        file, message, line = self.args
        return _cite(file, line, message)


class ProblemKind(StrEnum):
    """What was skipped; the keys of the counts in summary.json."""

    IMAGE = "bad_image"
    ROW = "bad_row"
    STAMP = "backwards_stamp"
    JOINTS = "bad_joints"
    UNPAIRED = "unpaired_frame"
    TOUCHES = "unknown_touches"


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that was skipped while the rest was read: which file and line, and why."""

    kind: ProblemKind
    file: Path
    line: int | None
    message: str

    def __str__(self) -> str:
        return _cite(self.file, self.line, self.message)


def count_by_kind(problems: Iterable[Problem]) -> dict[str, int]:
    """How many problems there are of every kind, zeros included."""
    counts = Counter(problem.kind for problem in problems)
    return {kind.value: counts[kind] for kind in ProblemKind}


def first_line(error: Exception) -> str:
    """What an exception says, on one line: the system's own words for an OSError."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())


def _cite(file: Path | str, line: int | None, message: str) -> str:
    where = f"{file}" if line is None else f"{file}:{line}"
    return " ".join(f"{where}: {message}".splitlines())
