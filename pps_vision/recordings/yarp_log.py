"""The data.log of one yarpdatadumper port: "index stamp payload" a line, read row by row.

With both times in a row the sender's stamp comes before the receiver's; the sender's is used.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.text import number, read_lines
from pps_vision.recordings.warnings import Problem, ProblemKind

_STAMP_LIMIT_S = 1e12  # beyond any clock; keeps differences of stamps finite


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
    for line, text in enumerate(read_lines(log, f"rows of {expected}"), start=1):
        words = text.split()
        row = _parse(line, words, n_numbers) if words else None
        if row is not None:
            rows.append(row)
        elif words:
            bad.append(Problem(ProblemKind.ROW, log, line, f"'{' '.join(words)[:60]}'; expected {expected}"))
    if bad and not rows:
        raise InputError(log, f"{bad[0].message}; none of {len(bad)} rows can be read", bad[0].line)
    problems += bad
    return _in_order(log, rows, problems, distinct_stamps)


def _parse(line: int, words: list[str], n_numbers: int | None) -> LogRow | None:
    """The row, or None if it has not the form of one."""
    numbers = [_number_or_none(word) for word in words]
    begin = len(words) - n_numbers if n_numbers is not None else (*numbers, None).index(None)
    head = numbers[: max(begin, 0)]
    payload = numbers[max(begin, 0) :]
    if len(head) not in (2, 3) or any(value is None or not abs(value) < _STAMP_LIMIT_S for value in head):
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
