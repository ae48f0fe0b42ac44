"""The robot's skin calibration, skin_positions/*.txt: where every physical taxel of a body part is and faces."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.problems import first_line
from pps_vision.types import Array, Mask

_KEYS = ("name", "spatial_sampling", "taxel2Repr")
_CALIBRATION = "[calibration]"


@dataclass(frozen=True)
class SkinPositions:
    """Positions in m and normals, as recorded (not all of unit length), (n, 3) in the body part's frame.

    The row is the taxel's number; a row of zeros stands for a number without a taxel.  `mapping` (n,) says
    which taxel represents it in its virtual taxel, −1 none; `spatial_sampling` is the file's own word.
    """

    name: str
    spatial_sampling: str
    mapping: tuple[int, ...]
    positions_m: Array
    normals: Array

    @property
    def exists(self) -> Mask:
        """(n,) which numbers have a taxel."""
        return np.any(self.positions_m != 0, axis=1) | np.any(self.normals != 0, axis=1)


def read_skin_positions(file: Path) -> SkinPositions:
    """All a skin position file holds but its white space; InputError names the file, the line and the value."""
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected a skin position file") from error
    head: dict[str, tuple[str, int]] = {}
    rows: list[list[float]] | None = None
    for number, text in enumerate(lines, start=1):
        words = text.split()
        if not words:
            continue
        if rows is not None:
            rows.append(_row(file, number, words))
        elif words == [_CALIBRATION]:
            rows = []
        elif words[0] in _KEYS and words[0] not in head:
            head[words[0]] = (text.strip().removeprefix(words[0]).strip(), number)
        else:
            raise InputError(file, f"'{text[:40]}'; expected each of {', '.join(_KEYS)} once, {_CALIBRATION}", number)
    missing = [key for key in _KEYS if key not in head] + [_CALIBRATION] * (not rows)
    if missing:
        raise InputError(file, f"no {missing[0]}; expected {', '.join(_KEYS)}, and rows after {_CALIBRATION}")
    mapping = _mapping(file, *head["taxel2Repr"], n=len(rows or ()))
    table = np.array(rows)
    return SkinPositions(head["name"][0], head["spatial_sampling"][0], mapping, table[:, :3], table[:, 3:])


def _row(file: Path, line: int, words: list[str]) -> list[float]:
    try:
        row = [float(word) for word in words]
    except ValueError as error:
        raise InputError(file, f"'{' '.join(words)[:60]}'; expected x y z nx ny nz", line) from error
    if len(row) != 6 or not np.all(np.isfinite(row)):
        raise InputError(file, f"'{' '.join(words)[:60]}'; expected x y z nx ny nz, all finite", line)
    return row


def _mapping(file: Path, text: str, line: int, n: int) -> tuple[int, ...]:
    words = text.removeprefix("(").removesuffix(")").split()
    try:
        mapping = tuple(int(word) for word in words)
    except ValueError as error:
        raise InputError(file, f"taxel2Repr {text[:40]}; expected whole numbers in brackets", line) from error
    if len(mapping) != n:
        raise InputError(file, f"taxel2Repr has {len(mapping)} numbers; expected {n}, one for each row", line)
    return mapping


def write_skin_positions(file: Path, skin: SkinPositions) -> None:
    """Write a skin position file; read again it is the same."""
    head = (skin.name, skin.spatial_sampling, f"({' '.join(map(str, skin.mapping))})")
    lines = [f"{key:<20}{value}" for key, value in zip(_KEYS, head, strict=True)]
    table = np.hstack([skin.positions_m, skin.normals]).tolist()
    rows = ["\t".join(map(repr, row)) for row in table]
    file.write_text("\n".join([*lines, _CALIBRATION, *rows, ""]))
