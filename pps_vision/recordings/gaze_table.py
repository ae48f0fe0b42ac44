"""Gaze postures as a table: yaw, pitch and vergence in degrees, a posture a line."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.tables import read_table, write_table
from pps_vision.types import Array

COLUMNS = ("yaw_deg", "pitch_deg", "vergence_deg")


def read_gaze(file: Path) -> Array:
    """(N, 3) rad; further columns are ignored.  InputError names the line and the value that is no number."""
    rows = read_table(file, "gaze postures")
    header = [name.strip() for name in rows[0]] if rows else []
    if missing := [name for name in COLUMNS if name not in header]:
        raise InputError(file, f"without {', '.join(missing)}; expected the columns {', '.join(COLUMNS)}", 1)
    columns = [header.index(name) for name in COLUMNS]
    degrees = [_numbers(file, line, row, columns) for line, row in enumerate(rows[1:], start=2) if row]
    return np.deg2rad(np.array(degrees, dtype=float).reshape(-1, 3))


def _numbers(file: Path, line: int, row: list[str], columns: list[int]) -> list[float]:
    numbers = []
    for name, column in zip(COLUMNS, columns, strict=True):
        text = row[column] if column < len(row) else ""
        try:
            numbers.append(float(text))
        except ValueError:
            raise InputError(file, f"{name} {text!r}; expected a number of degrees", line) from None
    return numbers


def write_reachability(file: Path, rows: Iterable[Iterable[object]]) -> None:
    """The postures again (degrees), each with 1 or 0 for reachable, its probability and degree, empty where unknown."""
    write_table(file, (*COLUMNS, "reachable", "probability", "degree"), rows)
