"""Tables as CSV: fields as text, and numbers to text with full precision, NaN and "none" as an empty field."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.problems import first_line


def cell(value: object) -> str:
    """One field: a float with all its digits, NaN empty, a truth value as 0 or 1."""
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else repr(float(value))
    return str(int(value)) if isinstance(value, bool | np.bool_) else str(value)


def read_table(file: Path, of: str) -> list[list[str]]:
    """The fields of every line, the header first, a byte-order mark left out; InputError where there is no table."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            return list(csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected a table of {of}") from error


def write_table(file: Path, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """A header and rows, comma separated."""
    with file.open("w", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(columns)
        table.writerows([cell(value) for value in row] for row in rows)
