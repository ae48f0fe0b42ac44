"""Image sequences without a log: stereo by file-name patterns, or one folder of frames."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from glob import glob
from itertools import pairwise
from pathlib import Path
from statistics import median_low

from pps_vision.errors import InputError
from pps_vision.recordings.image_file import ImageFile, check_size, decode, number_in
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.recordings.recording import Recording, note_unpaired, size_of_first
from pps_vision.types import Image

_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")


def open_stereo_images(left_globs: Sequence[str], right_globs: Sequence[str], fps: float) -> Recording:
    """Two sequences of one stereo camera, paired by the last number in each file's name.

    The number counts frames, so a missing one leaves a gap in the stamps.  Unpaired images are
    noted in `problems`.  InputError if a pattern matches nothing, or one number comes twice.
    """
    if not 0 < fps < float("inf"):
        raise InputError("recording", f"fps {fps}; expected a positive number of frames a second")
    problems: list[Problem] = []
    left, right = (_by_number(patterns, problems) for patterns in (left_globs, right_globs))
    numbers = sorted(left | right)
    step = median_low([b - a for a, b in pairwise(numbers)] or [1])

    def files(paths: dict[int, Path]) -> list[ImageFile]:
        return [ImageFile(paths[n], (n - numbers[0]) / step / fps) for n in sorted(paths)]

    for mine, others, which in ((left, right, "right"), (right, left, "left")):
        paired = {place for place, n in enumerate(sorted(mine)) if n in others}
        note_unpaired(files(mine), paired, f"{which} image of the same number", problems)
    common = left.keys() & right.keys()
    both = [files({n: paths[n] for n in common}) for paths in (left, right)]
    pairs = tuple(zip(*both, strict=True))
    name = _briefly(left_globs)
    return Recording(name, pairs, size_of_first(name, pairs, problems), problems)


def _by_number(patterns: Sequence[str], problems: list[Problem]) -> dict[int, Path]:
    """The files that patterns (or names, where the shell expanded them) match, by their number;
    one without a number is noted."""
    matched = {Path(name).absolute(): Path(name) for pattern in patterns for name in glob(pattern, recursive=True)}
    paths = [path for path in matched.values() if path.is_file()]
    if not paths:
        raise InputError(_briefly(patterns), "matches no file; expected a pattern of image files, such as 'left/*.png'")
    numbered: dict[int, Path] = {}
    for path in sorted(paths, key=natural_order):
        number = number_in(path)
        if number is None:
            found = "no number in its name; expected one to pair it by"
            problems.append(Problem(ProblemKind.UNPAIRED, path, None, found))
        elif number in numbered:
            raise InputError(path, f"number {number} again; expected each once, and {numbered[number]} has it")
        else:
            numbered[number] = path
    return numbered


def _briefly(patterns: Sequence[str]) -> str:
    """The first of what may be hundreds of names, where a shell expanded the pattern."""
    return patterns[0] + (f" (and {len(patterns) - 1} more)" if len(patterns) > 1 else "")


@dataclass(frozen=True)
class ImageSequence:
    """One camera's frames in natural order; iterating yields (frame, image), the first file being 1."""

    files: tuple[ImageFile, ...]
    image_size: tuple[int, int]  # width, height
    problems: list[Problem]  # grows while images are decoded

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[tuple[int, Image]]:
        """InputError if an image has another size than the first."""
        for frame, file in enumerate(self.files, start=1):
            image = decode(file)
            if not isinstance(image, Problem):
                check_size(file, image, self.image_size)
                yield frame, image
            elif image not in self.problems:
                self.problems.append(image)


def open_frames(folder: Path) -> ImageSequence:
    """The images of a folder in natural order; InputError if there is none that can be read."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder; expected one with the frames of a sequence")
    paths = [path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file()]
    files = tuple(ImageFile(path, 0.0) for path in sorted(paths, key=natural_order))
    first = next((image for image in map(decode, files) if not isinstance(image, Problem)), None)
    if first is None:
        raise InputError(folder, f"no usable frame among {len(files)} images; expected files such as 0001.png")
    return ImageSequence(files, (first.shape[1], first.shape[0]), [])


def natural_order(path: Path) -> tuple[tuple[int, str], ...]:
    """A sorting key under which frame2 comes before frame10."""
    words = re.findall(r"[0-9]+|[^0-9]+", str(path))
    return tuple((int(word[-18:]), "") if word[0] in "0123456789" else (-1, word) for word in words)
