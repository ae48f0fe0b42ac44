"""The true path of a rendered object, truth.csv: written by `render`, read beside a recording.

An empty field is a number that does not exist, such as the pixel of an object behind the camera.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.problems import Problem, ProblemKind, first_line
from pps_vision.recordings.tables import write_table
from pps_vision.types import Truth

COLUMNS = (
    *("stamp_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "radius_m"),
    *("u_left_px", "v_left_px", "u_right_px", "v_right_px", "visible_left", "visible_right"),
)


def write_truth(file: Path, rows: Iterable[Truth]) -> None:
    """Write truth.csv."""
    write_table(file, COLUMNS, (_cells(row) for row in rows))


def _cells(row: Truth) -> tuple[object, ...]:
    vectors = (*row.position, *row.velocity, row.radius_m, *row.left_px, *row.right_px)
    return (row.stamp_s, *vectors, row.visible_left, row.visible_right)


def read_truth(file: Path, problems: list[Problem]) -> tuple[Truth, ...]:
    """The rows of truth.csv; a bad row is noted in `problems` and skipped, another header is InputError."""
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected a table of the true path") from error
    if not lines or lines[0] != ",".join(COLUMNS):
        raise InputError(file, f"other columns than expected: {','.join(COLUMNS)}", 1)
    rows = []
    for line, text in enumerate(lines[1:], start=2):
        try:
            rows.append(_parse(text.split(",")))
        except ValueError as error:
            problems.append(Problem(ProblemKind.ROW, file, line, first_line(error)))
    return tuple(rows)


def _parse(cells: list[str]) -> Truth:
    if len(cells) != len(COLUMNS):
        raise ValueError(f"{len(cells)} fields; expected {len(COLUMNS)}")
    values = np.array([float(cell) if cell else np.nan for cell in cells])
    if not np.all(np.isfinite(values[:8])):
        raise ValueError("stamp, position, velocity or radius is no number; expected finite ones")
    if not set(cells[12:]) <= {"0", "1"}:
        raise ValueError(f"visible {','.join(cells[12:])}; expected 0 or 1")
    visible = [cell == "1" for cell in cells[12:]]
    return Truth(
        float(values[0]),
        values[1:4],
        values[4:7],
        float(values[7]),
        values[8:10],
        values[10:12],
        visible[0],
        visible[1],
    )
