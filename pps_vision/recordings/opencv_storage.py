"""The matrices in an OpenCV file storage (XML, YAML, JSON), recognised by the names people give them."""

import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.problems import first_line
from pps_vision.types import Array

Side = Literal["left", "right"]


class Kind(Enum):
    """What an entry is; the value says it in an error message."""

    K = "camera matrix"
    DISTORTION = "distortion coefficients"
    R = "rotation between the cameras"
    T = "translation between the cameras"
    P = "projection matrix after rectification"
    RECTIFY = "rectifying rotation"
    WIDTH = "image width"
    HEIGHT = "image height"
    SIZE = "image size"


# Names of one camera's entries may carry its side before or after them; the others stand alone.
_SIDED = {
    Kind.K: r"k|m|cm|mtx|intrinsics?|intrinsic_?matrix|cam(era)?_?mat(rix)?",
    Kind.DISTORTION: r"d|dist|distortion|dist(ortion)?_?coef(f|fs|ficients?)",
    Kind.P: r"p|projection(_?matrix)?",
    Kind.RECTIFY: r"r|rectification(_?matrix)?",
}
_ALONE = {
    Kind.R: r"r|rot|rotation(_?matrix)?",
    Kind.T: r"t|trans|translation(_?vector)?",
    Kind.WIDTH: r"(image_?)?width",
    Kind.HEIGHT: r"(image_?)?height",
    Kind.SIZE: r"im(a)?ge?_?size",
}
_SIDES: dict[str, Side] = {"1": "left", "l": "left", "left": "left", "2": "right", "r": "right", "right": "right"}


@dataclass(frozen=True)
class Entry:
    """A recognised matrix, as a flat row of numbers: which file it is from and which eye it is of,
    if its name says so."""

    file: Path
    key: str
    kind: Kind
    side: Side | None
    numbers: Array

    @property
    def lacks_side(self) -> bool:
        """Whether it belongs to one eye without saying which."""
        return self.side is None and self.kind in _SIDED


def read_entries(file: Path) -> list[Entry]:
    """All entries of a file whose names say what they are; InputError if it cannot be read or has none."""
    try:
        text = file.read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected an OpenCV calibration") from error
    # YAML from elsewhere (ROS) lacks the first lines that OpenCV insists on
    added = "" if text.lstrip().startswith(("%YAML", "<", "{")) else "%YAML:1.0\n---\n"
    storage = cv2.FileStorage()
    try:
        storage.open(added + text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        keys = root.keys() if root.isMap() else ()
        named = [(key, what) for key in keys if (what := _recognise(key)) is not None]
        entries = [Entry(file, key, *what, _numbers(file, key, root.getNode(key))) for key, what in named]
    except cv2.error as error:
        raise _unreadable(file, error, added.count("\n")) from error
    if not entries:
        expected = "camera_matrix, distortion_coefficients, R, T or the like"
        raise InputError(file, f"holds no calibration that can be recognised; expected {expected}")
    return entries


def _recognise(key: str) -> tuple[Kind, Side | None] | None:
    """What a name stands for, and for which eye."""
    name = re.sub(r"[-. ]", "_", key.lower())
    for kind, pattern in _ALONE.items():
        if re.fullmatch(pattern, name):
            return kind, None
    for kind, pattern in _SIDED.items():
        match = re.fullmatch(rf"((?P<before>left|right)_?)?({pattern})(_?(?P<after>left|right|l|r|1|2))?", name)
        if match:
            side = match["before"] or match["after"]
            return kind, _SIDES[side] if side else None
    return None


def _numbers(file: Path, key: str, node: cv2.FileNode) -> Array:
    """All numbers of an entry in a row: a matrix, a (nested) list, or a matrix as ROS writes one."""
    if node.isMap():
        data = node.getNode("data")
        is_matrix = node.getNode("type_id").isString() or node.getNode("dt").isString()
        return np.ravel(node.mat()).astype(float) if is_matrix else _numbers(file, key, data)
    if node.isSeq():
        return np.concatenate([np.zeros(0), *(_numbers(file, key, node.at(i)) for i in range(node.size()))])
    if node.isInt() or node.isReal():
        return np.array([node.real()])
    raise InputError(file, f"{key} is not made of numbers; expected a matrix")


def _unreadable(file: Path, error: cv2.error, lines_added: int) -> InputError:
    """OpenCV's parsing error as ours, with the line if it names one."""
    place = re.findall(r"\((\d+)\): ([^\n]+)", str(error))
    why, line = (place[-1][1].rstrip("'"), int(place[-1][0]) - lines_added) if place else (f"{error.err}", None)
    return InputError(file, f"cannot be parsed: {why}; expected OpenCV's XML, YAML or JSON", line)
