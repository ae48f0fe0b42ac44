"""Offsets of a robot's encoders as a table: joint and offset_deg, a joint a line."""

from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.tables import read_table, write_table
from pps_vision.types import Array

COLUMNS = ("joint", "offset_deg")
_LARGEST_DEG = 90.0  # an encoder further off is no encoder


def write_joint_offsets(file: Path, joints: tuple[str, ...], offsets_rad: Array) -> None:
    """What is to be added to each joint's encoder."""
    write_table(file, COLUMNS, zip(joints, np.rad2deg(offsets_rad), strict=True))


def read_joint_offsets(file: Path, joints: tuple[str, ...]) -> Array:
    """(n,) rad for these joints, 0 for those without a line.  InputError names the line and what is wrong with it."""
    rows = read_table(file, "joint offsets")
    if not rows or tuple(name.strip() for name in rows[0]) != COLUMNS:
        raise InputError(file, f"header {','.join(rows[0]) if rows else ''!r}; expected {','.join(COLUMNS)}", 1)
    offsets: dict[str, float] = {}
    for line, row in enumerate(rows[1:], start=2):
        if row:
            joint, degrees = _offset(file, line, row, joints)
            if joint in offsets:
                raise InputError(file, f"{joint} again; expected each joint once", line)
            offsets[joint] = degrees
    return np.deg2rad([offsets.get(joint, 0.0) for joint in joints])


def _offset(file: Path, line: int, row: list[str], joints: tuple[str, ...]) -> tuple[str, float]:
    """A joint and its degrees."""
    joint, text = row[0].strip(), row[1].strip() if len(row) > 1 else ""
    if joint not in joints:
        raise InputError(file, f"joint {joint!r}; expected one of {', '.join(joints)}", line)
    try:
        degrees = float(text)
    except ValueError:
        degrees = np.nan
    if not abs(degrees) <= _LARGEST_DEG:
        raise InputError(file, f"{joint} {text!r}; expected an offset within ±{_LARGEST_DEG:.0f} degrees", line)
    return joint, degrees
