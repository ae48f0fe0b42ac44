"""A stereo recording, however it is stored: pairs of images with their stamps and joints."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pps_vision.errors import InputError, expect_kinds
from pps_vision.geometry.camera import StereoRig
from pps_vision.parent import tell_progress
from pps_vision.recordings.image_file import ImageFile, decode, only_within, used_bits
from pps_vision.recordings.read_ahead import read_ahead
from pps_vision.recordings.source import expect_skew
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.types import Array, StereoFrame, Truth

if TYPE_CHECKING:  # kinematics take 0.2 s to load, and are not installed where there is only tracking
    from pps_vision.robot.model import Robot

Pair = tuple[ImageFile, ImageFile]
FileT = TypeVar("FileT", bound=ImageFile)

_SIZED = 10  # readable images whose sizes are compared
_AHEAD = 2  # pairs that are decoded beside the work on one; more take memory and save no time
_SAME_RATE = 0.01  # by which 29.97 and 30 frames a second differ, and more


@dataclass(frozen=True, slots=True)
class Touch:
    """Which virtual taxels "part:id" were touched at a stamp; empty when the skin reports none."""

    stamp_s: float
    taxel_ids: tuple[str, ...]


@dataclass(frozen=True)
class Recording:
    """Stereo pairs in order of time; iterating decodes them one at a time.

    `len` counts the pairs, those included whose image turns out to be unreadable: they are
    skipped and added to `problems`, which collects everything skipped up to now.  `name` is the
    source's path; `robot` whose joints the frames carry, and `rig` its cameras, where known, else
    `calibration_at` says where a calibration is expected.  `warnings` name input that was read but is
    probably a mistake, `notes` say how it was read; `unit_m` is the requested unit of the calibration.  A pixel is
    `pixel_aspect` times as wide as high, by the files.  Images are grey outside of `roi` (x, y, width, height).
    """

    name: str
    pairs: tuple[Pair, ...]
    image_size: tuple[int, int]  # width, height
    problems: list[Problem]
    robot: "Robot | None" = None
    rig: StereoRig | None = None
    touches: tuple[Touch, ...] = ()
    truth: tuple[Truth, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    unit_m: float = 1.0
    pixel_aspect: float = 1.0
    roi: tuple[int, int, int, int] | None = None
    right_size: tuple[int, int] | None = None  # of right images, where they are of another size
    calibration_at: str = "one by --calib"
    _noted: set[Problem] = field(default_factory=set, repr=False, compare=False)
    """Images that are in `problems` already."""

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def image_sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Width and height of the left and the right images."""
        return self.image_size, self.right_size or self.image_size

    @property
    def skipped(self) -> int:
        """Number of rows and images skipped up to now."""
        return sum(problem.count for problem in self.problems)

    def calibrated(self) -> StereoRig:
        """The cameras; InputError without a calibration."""
        if self.rig is None:
            raise InputError(self.name, f"holds no calibration; expected {self.calibration_at}")
        return self.rig

    @property
    def fps(self) -> float:
        """Stereo pairs per second, by the median interval; 20 where there is none."""
        usual_s = usual_step_s([left.stamp_s for left, _ in self.pairs])
        return 1 / usual_s if usual_s > 0 else 20.0

    @cached_property
    def bits(self) -> int:
        """The highest bit that images of 16 bits a channel use."""
        return used_bits([file for pair in self.pairs for file in pair])

    def part(
        self, start_s: float = 0.0, stop_s: float | None = None, roi: tuple[int, int, int, int] | None = None
    ) -> "Recording":
        """The pairs between two times from the first, images grey outside of a box x, y, width, height.

        InputError where nothing is left.
        """
        expect_kinds("recording", locals(), Recording.part.__annotations__)
        if roi is not None:
            x, y, w, h = roi
            if not (0 <= x < x + w <= self.image_size[0] and 0 <= y < y + h <= self.image_size[1]):
                raise InputError(self.name, f"roi {x} {y} {w} {h}; expected X Y W H within {self.image_size} pixels")
        first_s, last_s = (self.pairs[k][0].stamp_s for k in (0, -1))
        end_s = last_s if stop_s is None else first_s + stop_s
        kept = tuple(pair for pair in self.pairs if first_s + start_s <= pair[0].stamp_s <= end_s)
        if not kept:
            asked = f"from {start_s:g} s to {'the end' if stop_s is None else f'{stop_s:g} s'} there is no pair"
            raise InputError(self.name, f"{asked}; expected times from 0 to {last_s - first_s:.2f} s")
        return replace(self, pairs=kept, roi=roi)

    def with_joint_offsets(self, offsets_rad: Array | Sequence[float]) -> "Recording":
        """The recording with offsets (n_joints,) added to its joints; without offsets itself."""
        if not len(offsets_rad):
            return self

        def moved(file: ImageFile) -> ImageFile:
            return file if file.joints_rad is None else replace(file, joints_rad=file.joints_rad + offsets_rad)

        return replace(self, pairs=tuple((moved(left), moved(right)) for left, right in self.pairs))

    def __iter__(self) -> Iterator[StereoFrame]:
        return (frame for _, frame in self.numbered())

    def read_ahead(self) -> Iterator[tuple[int, StereoFrame]]:
        """`numbered`, decoding the next pairs in another thread, where the source can be read in one."""
        return read_ahead(self.numbered(), _AHEAD) if self.pairs[0][0].any_thread else self.numbered()

    def numbered(self) -> Iterator[tuple[int, StereoFrame]]:
        """(frame, pair): the number in the left image's file name (its place where it has none), so that a frame keeps
        its number when others are skipped."""
        for place, (left, right) in enumerate(self.pairs):
            tell_progress()
            files = zip((left, right), self.image_sizes, strict=True)
            images = [decode(file, size, self.bits) for file, size in files]
            for image in images:
                if isinstance(image, Problem) and image not in self._noted:
                    self._noted.add(image)
                    self.problems.append(image)
            if not isinstance(images[0], Problem) and not isinstance(images[1], Problem):
                number = place if left.number is None else left.number
                shown = [only_within(image, self.roi) for image in images if not isinstance(image, Problem)]
                joints = left.joints_rad, right.joints_rad
                yield number, StereoFrame(shown[0], shown[1], left.stamp_s, right.stamp_s, *joints)


def usual_sizes(
    source: Path | str, pairs: tuple[Pair, ...], problems: list[Problem]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """(width, height) that most of the first readable left images have, and the right ones; InputError, with the first
    problem, if no pair is readable."""
    sizes = Counter[tuple[int, int]](), Counter[tuple[int, int]]()  # of left and right images
    bad = [*problems]
    for pair in pairs:
        images = [decode(file) for file in pair]
        bad += [image for image in images if isinstance(image, Problem)]
        read = [image for image in images if not isinstance(image, Problem)]
        for counts, image in zip(sizes, read if len(read) == len(pair) else (), strict=False):
            counts[image.shape[1], image.shape[0]] += 1
        if sizes[0].total() >= _SIZED / 2:
            break
    if not sizes[0]:
        why = f"; {bad[0]}" if bad else ""
        raise InputError(source, f"no usable frame; expected at least one readable pair of left and right images{why}")
    usual = (sizes[0] + sizes[1]).most_common(1)[0][0]
    left, right = (usual if usual in counts else counts.most_common(1)[0][0] for counts in sizes)
    return left, right


def usual_size(source: Path | str, pairs: tuple[Pair, ...], problems: list[Problem]) -> tuple[int, int]:
    """The same where left and right images must be of one size; InputError if they are not."""
    left, right = usual_sizes(source, pairs, problems)
    if left != right:
        file = pairs[0][1]
        reason = f"{right[0]}×{right[1]} pixels; left images are {left[0]}×{left[1]}; expected one size"
        raise InputError(file.cited, reason, file.line)
    return left


def replaced_rate(option: str, fps: float, stamps_s: Sequence[float]) -> tuple[str, ...]:
    """A warning where the rate of an option replaces the files' own stamps, and differs from these."""
    steps_s = np.diff(stamps_s)
    usual = np.abs(steps_s - usual_step_s(stamps_s)) < 0.1 * usual_step_s(stamps_s)  # of stamps in whole ms the mean
    own = 1 / float(np.mean(steps_s[usual])) if np.any(usual) else fps
    return (f"{option} replaces the files' own {own:.2f}",) if abs(fps / own - 1) > _SAME_RATE else ()


def clocks_apart(left: Sequence[ImageFile], right: Sequence[ImageFile], pairs: int, max_skew_s: float) -> Iterator[str]:
    """A warning where as many images of both sides begin and end equally far apart, as those of two clocks do;
    InputError where that leaves no pair."""
    begin_s, end_s = (right[k].stamp_s - left[k].stamp_s for k in (0, -1))
    step_s = usual_step_s([file.stamp_s for file in left])
    if not pairs:
        reason = f"{len(left)} left and {len(right)} right images, which begin {begin_s:+.3f} s from the left ones"
        way_out = "stamps of one clock; or --fps, which pairs images and frames by number"
        message = f"{reason}: no two are within {1000 * max_skew_s:g} ms (--max-skew-s); expected {way_out}"
        raise InputError(right[0].cited, message, right[0].line)
    if len(left) == len(right) and abs(begin_s) > max(max_skew_s, 2 * step_s) and abs(end_s - begin_s) < step_s:
        yield (
            f"the right images begin and end {begin_s:+.3f} s from the left ones: if both cameras began together, "
            "their clocks did not, and --fps pairs the images by number"
        )


def usual_step_s(stamps_s: Sequence[float]) -> float:
    """The median interval; 0 where there is none."""
    return float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else 0.0


def pair_by_stamp(
    left: Sequence[ImageFile], right: Sequence[ImageFile], max_skew_s: float, problems: list[Problem]
) -> tuple[Pair, ...]:
    """As many images as possible in pairs at most `max_skew_s` apart, as close as possible.

    Both lists are in the order of their stamps; pairs are one to one and never cross.  The
    unpaired are noted.
    """
    expect_skew(max_skew_s)
    matches = _match([file.stamp_s for file in left], [file.stamp_s for file in right], max_skew_s)
    wanted = f"image within {1000 * max_skew_s:g} ms"
    note_unpaired(left, {i for i, _ in matches}, f"right {wanted}", problems)
    note_unpaired(right, {j for _, j in matches}, f"left {wanted}", problems)
    return tuple((left[i], right[j]) for i, j in matches)


def distinct_stamps(files: Iterable[FileT], problems: list[Problem]) -> list[FileT]:
    """The files in the order of their stamps; of several with one stamp the first, the others are noted."""
    unique_files: list[FileT] = []
    for file in sorted(files, key=lambda file: file.stamp_s):
        if unique_files and file.stamp_s == unique_files[-1].stamp_s:
            reason = f"{file.title} has the stamp of {unique_files[-1].title}; expected each once"
            problems.append(Problem(ProblemKind.STAMP, file.cited, file.line, reason))
        else:
            unique_files.append(file)
    return unique_files


def note_unpaired(files: Sequence[ImageFile], paired: set[int], wanted: str, problems: list[Problem]) -> None:
    """A problem for all files in a row whose places are not in `paired`."""
    for is_paired, places in groupby(range(len(files)), paired.__contains__):
        row = [files[place] for place in places]
        if not is_paired:
            reason = f"{row[0].title} is" if len(row) == 1 else f"{row[0].title} to {row[-1].title} ({len(row)}) are"
            message = f"{reason} unpaired; expected a {wanted}"
            problems.append(Problem(ProblemKind.UNPAIRED, row[0].cited, row[0].line, message, len(row)))


_Pairing = tuple[int, int, "_Pairing"] | None  # the last pair (places in left and right), and those before it


def _match(left: list[float], right: list[float], max_skew_s: float) -> list[tuple[int, int]]:
    """The pairs of places with the least sum of skews, an unpaired image costing `max_skew_s`.

    Dynamic programming over the left images; mutual nearness instead would lose most pairs of
    eyes that are half a frame apart.
    """
    first = np.searchsorted(right, np.subtract(left, max_skew_s), "left")
    end = np.searchsorted(right, np.add(left, max_skew_s), "right")
    saved_by_pair = 2 * max_skew_s + 1e-9  # two images are no longer unpaired; a tie goes to the pair
    best: list[tuple[float, _Pairing]] = [(0.0, None)]  # saving and chain with the first j right images only
    for i, stamp_s in enumerate(left):
        best += [best[-1]] * (int(end[i]) + 1 - len(best))
        within = range(int(first[i]), int(end[i]))
        longer: list[tuple[float, _Pairing]] = [
            (best[j][0] + saved_by_pair - abs(stamp_s - right[j]), (i, j, best[j][1])) for j in within
        ]
        for j, chain in zip(within, longer, strict=True):
            best[j + 1] = max(best[j + 1], best[j], chain, key=lambda option: option[0])
    matches = []
    link = best[-1][1]
    while link is not None:
        i, j, link = link
        matches.append((i, j))
    return matches[::-1]
