"""One camera's image sequence: a folder of frames, or a video."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.image_file import ImageFile, decode
from pps_vision.recordings.video import is_video, open_video
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Image

_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")


@dataclass(frozen=True)
class ImageSequence:
    """One camera's frames in natural order; iterating yields (frame, image), the first file being 1."""

    files: tuple[ImageFile, ...]
    image_size: tuple[int, int]  # width, height
    problems: list[Problem]  # from the last iteration

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[tuple[int, Image]]:
        self.problems.clear()
        for frame, file in enumerate(self.files, start=1):
            image = decode(file, self.image_size)
            if isinstance(image, Problem):
                self.problems.append(image)
            else:
                yield frame, image


def open_frames(folder: Path) -> ImageSequence:
    """The images of a folder in natural order, or of a video; InputError if none is readable."""
    files: tuple[ImageFile, ...]
    if is_video(folder):
        files = tuple(open_video(folder, fps=1.0))
    elif folder.is_dir():
        files = tuple(ImageFile(path, 0.0) for path in images_in(folder))
    else:
        reason = "is no folder and no video" if folder.exists() else "no such folder"
        raise InputError(folder, f"{reason}; expected a folder with the frames of a sequence, or a video")
    first = next((image for image in map(decode, files) if not isinstance(image, Problem)), None)
    if first is None:
        raise InputError(folder, f"no usable frame among {len(files)} images; expected files such as 0001.png")
    return ImageSequence(files, (first.shape[1], first.shape[0]), [])


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder in natural order."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file()]
    return sorted(paths, key=natural_order)


def natural_order(path: Path) -> tuple[tuple[int, str], ...]:
    """A sorting key under which frame2 comes before frame10."""
    words = re.findall(r"[0-9]+|[^0-9]+", str(path))
    return tuple((int(word), "") if word[0] in "0123456789" else (-1, word) for word in words)
