"""A stereo recording, however it is stored: pairs of images with their stamps and joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.image_file import ImageFile, check_size, decode
from pps_vision.recordings.problems import Problem
from pps_vision.robot.model import Robot
from pps_vision.types import Image, StereoFrame, Truth

Pair = tuple[ImageFile, ImageFile]


@dataclass(frozen=True, slots=True)
class Touch:
    """Which virtual taxels "part:id" were touched at a stamp; empty when the skin reports none."""

    stamp_s: float
    taxel_ids: tuple[str, ...]


@dataclass(frozen=True)
class Recording:
    """Stereo pairs in order of time; iterating decodes them one at a time.

    `len` counts the pairs, those included whose image turns out to be unreadable: they are
    skipped and added to `problems`, which holds all that was skipped so far.  `name` is the
    source as it was given; `robot` whose joints the frames carry, and `rig` its cameras, where known.
    """

    name: str
    pairs: tuple[Pair, ...]
    image_size: tuple[int, int]  # width, height
    problems: list[Problem]
    robot: Robot | None = None
    rig: StereoRig | None = None
    touches: tuple[Touch, ...] = ()
    truth: tuple[Truth, ...] = ()

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def fps(self) -> float:
        """Stereo pairs per second, by the median interval; 20 where there is none."""
        steps = np.diff([left.stamp_s for left, _ in self.pairs])
        usual = float(np.median(steps)) if len(steps) else 0.0
        return 1 / usual if usual > 0 else 20.0

    def __iter__(self) -> Iterator[StereoFrame]:
        return (frame for _, frame in self.numbered())

    def numbered(self) -> Iterator[tuple[int, StereoFrame]]:
        """(frame, pair): the number in the left image's file name (its place where it has none),
        so that a frame keeps its number when others are skipped.  InputError if an image has
        another size than the first."""
        for place, (left, right) in enumerate(self.pairs):
            images = decode_pair(left, right, self.problems)
            if images is None:
                continue
            for file, image in zip((left, right), images, strict=True):
                check_size(file, image, self.image_size)
            number = place if left.number is None else left.number
            yield number, StereoFrame(*images, left.stamp_s, right.stamp_s, left.joints_rad, right.joints_rad)


def decode_pair(left: ImageFile, right: ImageFile, problems: list[Problem]) -> tuple[Image, Image] | None:
    """Both images, or None after noting which could not be read (once, however often asked)."""
    images = decode(left), decode(right)
    for image in images:
        if isinstance(image, Problem) and image not in problems:
            problems.append(image)
    if isinstance(images[0], Problem) or isinstance(images[1], Problem):
        return None
    return images[0], images[1]


def size_of_first(source: Path | str, pairs: tuple[Pair, ...], problems: list[Problem]) -> tuple[int, int]:
    """(width, height) of the first readable pair's left image; InputError if no pair is readable."""
    for left, right in pairs:
        images = decode_pair(left, right, problems)
        if images is not None:
            return images[0].shape[1], images[0].shape[0]
    why = f"; {problems[0]}" if problems else ""
    raise InputError(source, f"no usable frame; expected at least one readable pair of left and right images{why}")
