"""One image file: its pixels, and where it was named and stamped."""

import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.files import check_regular, read_bytes
from pps_vision.recordings import Layout
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.types import Array, Image

# An orientation tag would turn the image away from its calibration: pixels are taken as recorded.
_AS_RECORDED = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH
_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")
_FORMATS = ("BMP", "JPEG", "PNG", "PPM", "TIFF", "WEBP")
MOST_PIXELS = 2**23  # 3840×2160 and a little more: tracking takes 61 bytes for each pixel of both eyes
_STACKS = (".tif", ".tiff")
_ORIENTATION = 274  # EXIF's tag
_STAMP = re.compile(r"(?<![0-9.])(?:([0-9]{10}\.[0-9]+)|([0-9]{13}|[0-9]{16}|[0-9]{19}))(?![0-9])", re.ASCII)
_CLOCK = re.compile(  # time of day: 2024-05-17_14-30-05.123, 20240517T143005_123456, 14-30-05-123
    r"(?:(?<![0-9])([0-9]{4})[-_.]?([0-9]{2})[-_.]?([0-9]{2})[-_T .]?)?"
    r"(?<![0-9])(?P<h>[0-9]{2})[-_:.]?(?P<m>[0-9]{2})[-_:.]?(?P<s>[0-9]{2})[-_.,]([0-9]{3,9})(?![0-9])",
    re.ASCII,
)
_GREY = 128  # level outside of the region of interest
_LEVELS = 8  # bits that are kept
_SAMPLED = 8  # images whose bits are looked at
Pixels = NDArray[np.unsignedinteger[Any]]
"""An image (h, w, 3) as it was recorded, RGB, uint8 or uint16."""


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image on disk, its stamp, the robot's joints at that stamp, and the log row naming it."""

    path: Path
    stamp_s: float
    joints_rad: Array | None = None
    log: Path | None = None
    line: int | None = None
    index: int = field(default=-1, kw_only=True)  # its place in a video or a bag, from 0
    any_thread: ClassVar[bool] = True  # whether `load` works in other threads than the one that opened the recording

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

    def load(self) -> Pixels | str:
        """The image as RGB, or the reason why there is none."""
        try:
            data = read_bytes(self.path, "an image")
        except InputError as error:
            return f"cannot be opened ({error.args[1].partition(';')[0]})"
        return decode_bytes(data)


@dataclass(frozen=True, slots=True)
class Page(ImageFile):
    """One page of a TIFF stack; `index` counts the pages of all stacks, `page` this one's."""

    page: int = field(kw_only=True)

    @property
    def title(self) -> str:
        """What reports call it."""
        return f"page {self.page}"

    def load(self) -> Pixels | str:
        """The image as RGB, or the reason why there is none."""
        try:
            check_regular(self.path, "an image")
            content = np.memmap(self.path, np.uint8, "r")
            return _decoded(content, _pixels_stated(self.path, self.page), self.page)
        except (InputError, OSError, ValueError):
            return "cannot be opened"


def images_of(paths: Sequence[Path]) -> list[ImageFile]:
    """The images of files, not yet stamped and numbered by their names; of stacks of TIFF all pages, numbered in their
    order."""
    pages = [_pages(path) for path in paths]
    if max(pages, default=1) > 1:
        listed = [(path, page) for path, n in zip(paths, pages, strict=True) for page in range(n)]
        return [Page(path, 0.0, index=index, page=page) for index, (path, page) in enumerate(listed)]
    return [ImageFile(path, 0.0, index=-1 if number is None else number) for path, number in numbers_in(paths).items()]


def _pages(path: Path) -> int:
    """The number of images in a file; 1 where it is no stack of TIFF, or cannot be read."""
    if path.suffix.lower() not in _STACKS or not path.is_file():
        return 1
    return _stated(path, ("TIFF",), lambda image: getattr(image, "n_frames", 1))


def orientation_of(path: Path) -> int:
    """The orientation (EXIF, 1 to 8) that an image file states; 1 where it states none."""
    return _stated(path, _FORMATS, lambda image: image.getexif().get(_ORIENTATION, 1))


def _stated(path: Path, formats: tuple[str, ...], read: Callable[[PIL.Image.Image], Any]) -> int:
    """A number in an image's header; 1 where there is none, or it cannot be read."""
    try:
        with PIL.Image.open(path, formats=formats) as image:
            return int(read(image))
    except Exception:  # each of PIL's parsers raises its own kinds, and decoding will say why
        return 1


@dataclass(frozen=True, slots=True)
class Half(ImageFile):
    """One half of an image that shows the views of both cameras."""

    whole: ImageFile = field(kw_only=True)
    is_second: bool = field(kw_only=True)  # the right or the lower half
    axis: int = field(kw_only=True)  # 0: halves above each other, 1: side by side

    @property
    def number(self) -> int | None:
        """That of the whole image."""
        return self.whole.number

    @property
    def title(self) -> str:
        """What reports call it."""
        return self.whole.title

    def load(self) -> Pixels | str:
        """The image as RGB, or the reason why there is none."""
        image = self.whole.load()
        if isinstance(image, str) or image.shape[self.axis] % 2:
            return image if isinstance(image, str) else "has no two halves of one size"
        return np.ascontiguousarray(np.split(image, 2, self.axis)[self.is_second])


def halves(images: Iterable[ImageFile], layout: Layout) -> tuple[list[Half], list[Half]]:
    """The left and the right camera's halves of images."""
    axis = int(layout in ("lr", "rl"))
    left, right = (
        [Half(image.path, image.stamp_s, whole=image, is_second=second, axis=axis) for image in images]
        for second in (layout in ("rl", "bt"), layout in ("lr", "tb"))
    )
    return left, right


def decode_bytes(data: bytes) -> Pixels | str:
    """The image of a file's content as RGB, or the reason why there is none."""
    try:
        return _decoded(np.frombuffer(data, np.uint8), _pixels_stated(BytesIO(data)))
    except OSError:
        return "cannot be decoded"


def _decoded(content: NDArray[np.uint8], n_pixels: int, page: int | None = None) -> Pixels | str:
    if n_pixels > MOST_PIXELS:
        return f"states {n_pixels} pixels, over {MOST_PIXELS}"
    try:
        if page is None:
            image = cv2.imdecode(content, _AS_RECORDED)
        else:
            image = next(iter(cv2.imdecodemulti(content, _AS_RECORDED, range=(page, page + 1))[1]), None)
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        return "cannot be decoded"
    pixels: Any = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)  # IMREAD_COLOR_RGB is BGR for TIFF of 16 bits
    return np.asarray(pixels)


def number_in(path: Path) -> int | None:
    """The last number in a file's name (its suffix left out), None if there is none."""
    digits = re.findall(r"[0-9]+", path.stem)
    return int(digits[-1][-18:]) if digits else None


def numbers_in(paths: Sequence[Path]) -> dict[Path, int | None]:
    """The numbers of a camera's images: the last number of their names that is not the same in all, as that of the
    camera is; else the last."""
    digits = {path: re.findall(r"[0-9]+", path.stem) for path in paths}
    columns = list(zip(*digits.values(), strict=False)) if len({len(d) for d in digits.values()}) == 1 else []
    varying = [place for place, column in enumerate(columns) if len(set(column)) > 1]
    place = varying[-1] if varying else -1
    return {path: int(d[place][-18:]) if d else None for path, d in digits.items()}


def stamp_in(path: Path) -> float | None:
    """The time that a file is named after, s: since 1970 as "1403636579.763556" or 13 (ms), 16 (µs) or 19 (ns) digits,
    or a clock's with at least milliseconds, "2024-05-17_14-30-05.123" or, since midnight, "14-30-05-123"."""
    if match := _STAMP.search(path.stem):
        seconds, digits = match.groups()
        return float(seconds) if seconds else int(digits) / 10 ** (len(digits) - 10)
    if not (match := _CLOCK.search(path.stem)):
        return None
    year, month, day, hour, minute, second, fraction = match.groups()
    try:
        moment = datetime(
            int(year or 1970), int(month or 1), int(day or 1), int(hour), int(minute), int(second), tzinfo=UTC
        )
    except ValueError:
        return None
    return moment.timestamp() + int(fraction) / 10 ** len(fraction)


def decode(file: ImageFile, size: tuple[int, int] | None = None, bits: int = 16) -> Image | Problem:
    """The image as RGB uint8: grey is replicated, alpha dropped; of 16 bits a channel the upper 8 of `bits` are kept.

    Of another `size` (width, height) than expected it is a problem.
    """
    image = file.load()
    if isinstance(image, str):
        return _bad(file, image)
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        return _bad(file, f"is {width}×{height} pixels", f"{size[0]}×{size[1]} like the others")
    if image.dtype != np.uint8:
        image = np.minimum(image >> max(bits - _LEVELS, 0), 255)
    return np.asarray(image, np.uint8)


def only_within(image: Image, roi: tuple[int, int, int, int] | None) -> Image:
    """The image, grey outside of a box x, y, width, height."""
    if roi is None:
        return image
    x, y, w, h = roi
    part = np.full_like(image, _GREY)
    part[y : y + h, x : x + w] = image[y : y + h, x : x + w]
    return part


def used_bits(files: Sequence[ImageFile]) -> int:
    """The highest bit that images of 16 bits a channel use, as cameras of 10 or 12 bits leave the upper ones 0; by a
    few images, spread over all."""
    chosen = np.unique(np.linspace(0, len(files) - 1, _SAMPLED).astype(int)) if files else ()
    highest = 0
    for k in chosen:
        image = files[k].load()
        if isinstance(image, str):
            continue
        if image.dtype == np.uint8:
            break
        highest = max(highest, int(image.max()))
    return highest.bit_length() or 16


def _pixels_stated(source: BytesIO | Path, page: int = 0) -> int:
    """Return the number of pixels by an image's header; OSError if it is no header of an image."""
    try:
        with warnings.catch_warnings():  # PIL warns of sizes that are refused here anyhow
            warnings.simplefilter("ignore")
            with PIL.Image.open(source, formats=_FORMATS) as image:
                image.seek(page)
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
