"""One image file: its pixels, and where it was named and stamped."""

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pps_vision.errors import first_line
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.types import Array, Image

# An orientation tag would turn the image away from its calibration: pixels are taken as recorded.
_AS_RGB = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image on disk, its stamp, the robot's joints at that stamp, and the log row naming it."""

    path: Path
    stamp_s: float
    joints_rad: Array | None = None
    log: Path | None = None
    line: int | None = None

    @property
    def cited(self) -> Path:
        """The file a report about this image points at."""
        return self.log or self.path

    @property
    def number(self) -> int | None:
        """The last number in the file's name."""
        return number_in(self.path)


def number_in(path: Path) -> int | None:
    """The last number in a file's name (its suffix left out), None if there is none."""
    digits = re.findall(r"[0-9]+", path.stem)
    return int(digits[-1][-18:]) if digits else None


def decode(file: ImageFile, size: tuple[int, int] | None = None) -> Image | Problem:
    """The image as RGB uint8: grey is replicated, alpha dropped, 16 bits a channel cut to 8.

    Of another `size` (width, height) than expected it is a problem.
    """
    try:
        data = file.path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        return _bad(file, f"cannot be opened ({first_line(error)})")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _AS_RGB) if data else None
    except cv2.error:
        image = None
    if image is None:
        return _bad(file, "cannot be decoded")
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        return _bad(file, f"is {width}×{height} pixels", f"{size[0]}×{size[1]} like the others")
    return np.asarray(image, dtype=np.uint8)


def _bad(file: ImageFile, why: str, expected: str = "an image") -> Problem:
    return Problem(ProblemKind.IMAGE, file.cited, file.line, f"{file.path.name} {why}; expected {expected}")
