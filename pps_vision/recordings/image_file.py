"""One image file: its pixels, and where it was named and stamped."""

import re
import warnings
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import PIL.Image

from pps_vision.errors import InputError
from pps_vision.files import read_bytes
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.types import Array, Image

# An orientation tag would turn the image away from its calibration: pixels are taken as recorded.
_AS_RGB = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")
_FORMATS = ("BMP", "JPEG", "PNG", "PPM", "TIFF", "WEBP")
MOST_PIXELS = 2**23  # 3840×2160 and a little more: tracking takes 61 bytes for each pixel of both eyes
_STAMP = re.compile(r"(?<![0-9.])(?:([0-9]{10}\.[0-9]+)|([0-9]{13}|[0-9]{16}|[0-9]{19}))$", re.ASCII)


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image on disk, its stamp, the robot's joints at that stamp, and the log row naming it."""

    path: Path
    stamp_s: float
    joints_rad: Array | None = None
    log: Path | None = None
    line: int | None = None
    index: int = field(default=-1, kw_only=True)  # its place in a video or a bag, from 0

    @property
    def cited(self) -> Path:
        """The file a report about this image points at."""
        return self.log or self.path

    @property
    def number(self) -> int | None:
        """Its place in a video or a bag, or the last number in the file's name."""
        return number_in(self.path) if self.index < 0 else self.index

    @property
    def title(self) -> str:
        """What reports call it."""
        return self.path.name

    def load(self) -> Image | str:
        """The image as RGB uint8, or the reason why there is none."""
        try:
            data = read_bytes(self.path, "an image")
        except InputError as error:
            return f"cannot be opened ({error.args[1].partition(';')[0]})"
        return decode_bytes(data)


def decode_bytes(data: bytes) -> Image | str:
    """The image of a file's content as RGB uint8, or the reason why there is none."""
    try:
        n_pixels = _pixels_stated(data)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _AS_RGB) if n_pixels <= MOST_PIXELS else None
    except (cv2.error, OSError):
        return "cannot be decoded"
    if n_pixels > MOST_PIXELS:
        return f"states {n_pixels} pixels, over {MOST_PIXELS}"
    return "cannot be decoded" if image is None else np.asarray(image, dtype=np.uint8)


def number_in(path: Path) -> int | None:
    """The last number in a file's name (its suffix left out), None if there is none."""
    digits = re.findall(r"[0-9]+", path.stem)
    return int(digits[-1][-18:]) if digits else None


def stamp_in(path: Path) -> float | None:
    """The time since 1970 that a file is named after, s: "1403636579.763556", or 13 (ms), 16 (µs) or 19 (ns) digits."""
    if not (match := _STAMP.search(path.stem)):
        return None
    seconds, digits = match.groups()
    return float(seconds) if seconds else int(digits) / 10 ** (len(digits) - 10)


def decode(file: ImageFile, size: tuple[int, int] | None = None) -> Image | Problem:
    """The image as RGB uint8: grey is replicated, alpha dropped, 16 bits a channel cut to 8.

    Of another `size` (width, height) than expected it is a problem.
    """
    image = file.load()
    if isinstance(image, str):
        return _bad(file, image)
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        return _bad(file, f"is {width}×{height} pixels", f"{size[0]}×{size[1]} like the others")
    return image


def _pixels_stated(data: bytes) -> int:
    """Return the number of pixels by an image's header; OSError if it is no header of an image."""
    try:
        with warnings.catch_warnings():  # PIL warns of sizes that are refused here anyhow
            warnings.simplefilter("ignore")
            with PIL.Image.open(BytesIO(data), formats=_FORMATS) as image:
                return image.width * image.height
    except PIL.Image.DecompressionBombError:
        return MOST_PIXELS + 1
    except Exception as error:  # each of its parsers raises its own kinds (SyntaxError, struct.error, …)
        raise OSError("no header of an image") from error


def _bad(file: ImageFile, why: str, expected: str = "an image") -> Problem:
    return Problem(ProblemKind.IMAGE, file.cited, file.line, f"{file.title} {why}; expected {expected}")


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder in natural order."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file()]
    return sorted(paths, key=natural_order)


def natural_order(path: Path) -> tuple[tuple[int, str], ...]:
    """A sorting key under which frame2 comes before frame10."""
    words = re.findall(r"[0-9]+|[^0-9]+", str(path))
    return tuple((int(word), "") if word[0] in "0123456789" else (-1, word) for word in words)
