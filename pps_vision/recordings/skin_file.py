"""Where a robot's taxels are: a table, or the iCub's own calibration of a skin part.

The table (.csv) has a row for each taxel: part,frame,taxel,x_m,y_m,z_m,nx,ny,nz, its position and outward normal in a
frame of the robot.  The iCub's file (.ini, .txt) has `name`, `taxel2Repr` (the virtual taxel of each physical one, −1
none) and, below [calibration], a row x y z nx ny nz for each physical taxel; its frame is called as the part.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.tables import read_table
from pps_vision.recordings.taxels_ini import OUR_NAMES
from pps_vision.recordings.text import finite, read_lines, whole
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, SkinPart

TABLE = ("part", "frame", "taxel", "x_m", "y_m", "z_m", "nx", "ny", "nz")

Row = tuple[int, str, str, int, list[float]]
"""Line, part, frame, taxel, position and normal."""


def read_skin(files: Sequence[Path], robot: Robot) -> Skin:
    """The skin of a robot from one file or several.  InputError where a file cannot be read, or a row has no known
    frame, no new taxel, or no normal."""
    parts: dict[tuple[str, str], list[Row]] = {}
    taxels_read: set[tuple[str, int]] = set()
    for file in files:
        for row in _table(file) if file.suffix.lower() == ".csv" else _icub_part(file):
            line, part, frame, taxel, values = row
            if not part.isidentifier():
                raise InputError(file, f"part {part!r}; expected a name of letters, digits and _", line)
            if frame not in robot.frame_ids:
                raise InputError(file, f"frame {frame!r}; expected one of {', '.join(robot.frame_ids)}", line)
            if (part, taxel) in taxels_read or taxel < 0:
                raise InputError(file, f"taxel {part}:{taxel}; expected each number from 0 once", line)
            if not np.linalg.norm(values[3:]) > 0.5:
                raise InputError(file, f"normal {values[3:]}; expected one of length 1", line)
            taxels_read.add((part, taxel))
            parts.setdefault((part, frame), []).append(row)
    names = [part for part, _ in parts]
    if not parts or len(set(names)) < len(names):
        reason = "no taxel" if not parts else f"part {max(names, key=names.count)} in several frames"
        raise InputError(files[0] if files else "skin", f"{reason}; expected taxels, those of a part in one frame")
    return Skin(tuple(_part(*names, rows) for names, rows in parts.items()))


def _part(name: str, frame: str, rows: list[Row]) -> SkinPart:
    values = np.array([row[-1] for row in rows])
    normals = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return SkinPart(name, frame, tuple(row[3] for row in rows), values[:, :3], normals)


def _table(file: Path) -> list[Row]:
    rows = []
    for line, (part, frame, taxel, *numbers) in read_table(file, TABLE):
        try:
            rows.append((line, part, frame, whole(taxel), [finite(word) for word in numbers]))
        except ValueError as error:
            raise InputError(file, f"{first_line(error)}; expected {','.join(TABLE)}", line) from error
    return rows


def _icub_part(file: Path) -> list[Row]:
    """The virtual taxels of the iCub's file, each where its representative is."""
    part = ""
    representatives = None
    physical = []
    calibrated = False
    for line, text in enumerate(read_lines(file, "a skin part's calibration"), start=1):
        key, _, value = text.strip().partition(" ") if not calibrated else ("", "", text)
        try:
            if calibrated and text.split():
                numbers = [finite(word) for word in text.split()[:6]]
                if len(numbers) < 6:
                    raise ValueError(f"{len(numbers)} numbers")
                physical.append((line, numbers))
            elif key == "name":
                part = OUR_NAMES.get(value.strip(), value.strip())
            elif key == "taxel2Repr":
                representatives = [whole(word) for word in value.strip(" ()").split()]
        except ValueError as error:
            raise InputError(file, f"{first_line(error)}; expected x y z nx ny nz, or whole numbers", line) from error
        calibrated = calibrated or key == "[calibration]"
    if not part or not physical:
        raise InputError(file, f"{'no name' if not part else 'no taxel'}; expected name and rows below [calibration]")
    ids = range(len(physical)) if representatives is None else sorted({i for i in representatives if i >= 0})
    return [
        (physical[i][0], part, part, i, physical[i][1]) for i in ids if i < len(physical) and any(physical[i][1][3:])
    ]
