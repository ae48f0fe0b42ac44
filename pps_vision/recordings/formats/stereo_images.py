"""Image files of a stereo camera, paired by their stamps or the numbers in their names, with a calibration."""

from collections.abc import Sequence
from dataclasses import replace
from glob import glob
from itertools import pairwise
from pathlib import Path
from statistics import median_low

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings import MAX_SKEW_S
from pps_vision.recordings.image_file import ImageFile, images_in, natural_order, number_in, stamp_in
from pps_vision.recordings.recording import (
    Pair,
    Recording,
    Times,
    distinct_stamps,
    note_unpaired,
    pair_by_stamp,
    read_times,
    replaced_rate,
    usual_size,
)
from pps_vision.recordings.source import Source
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.video import is_video
from pps_vision.recordings.warnings import Problem, ProblemKind

FORMAT = "images by --left and --right"


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is None and not any(is_video(Path(name)) for name in (*source.left, *source.right))


def open_source(source: Source) -> Recording:
    """Open the images `source.left` and `source.right`; InputError if they or the calibration cannot be used."""
    check_options(source)
    times = read_times(source.times) if source.times else None
    recording = open_stereo_images(source.left, source.right, source.fps, times, source.max_skew_s)
    return with_calibration(recording, source.calib, source)


def with_calibration(
    recording: Recording, calib: Sequence[Path], source: Source, kitti: tuple[int, int] = (0, 1)
) -> Recording:
    """The recording with the cameras of a calibration, if one is given; a warning where it is for another size."""
    if not calib:
        return recording
    warnings = list(recording.warnings)
    cameras = read_stereo_calibration(calib, recording.image_size, source.unit_m, kitti, warnings)
    return replace(recording, rig=StereoRig.fixed(*cameras), warnings=tuple(warnings))


def refuse_robot_options(source: Source) -> None:
    """Raise InputError for options that go with a robot's recording only."""
    if source.joints:
        raise InputError("recording", f"joints {source.joints} without a robot; expected it with an iCub's folder REC")
    if source.taxels:
        raise InputError("recording", f"taxels {source.taxels} without skin; expected it with an iCub's folder REC")


def check_options(source: Source) -> None:
    """Raise InputError for options that contradict each other or are missing."""
    refuse_robot_options(source)
    if source.folder is None and not (source.left and source.right):
        option, missing = ("left", "right") if source.left else ("right", "left")
        name = (source.left or source.right)[0]
        raise InputError("recording", f"--{option} {name} without --{missing}; expected both")
    if source.fps is not None and source.times:
        raise InputError("recording", "fps and times; expected one of them")
    if source.fps is not None and not 0 < source.fps < float("inf"):
        raise InputError("recording", f"fps {source.fps}; expected a positive number of frames a second")


def open_stereo_images(
    left_globs: Sequence[str],
    right_globs: Sequence[str],
    fps: float | None = None,
    times: Times | None = None,
    max_skew_s: float = MAX_SKEW_S,
) -> Recording:
    """Two sequences of one stereo camera.

    With `fps` they are paired by the last number in each file's name, which counts frames, so that a missing one leaves
    a gap in the stamps.  Else the images are paired by their stamps, from `times` or from their names.
    Unpaired images are noted in `problems`.  InputError if a pattern matches nothing, one number comes twice, or the
    images have no stamps.
    """
    problems: list[Problem] = []
    name = _briefly(left_globs)
    if fps is None:
        sides = [_stamped(_matched(patterns), times, problems) for patterns in (left_globs, right_globs)]
        pairs = pair_by_stamp(sides[0], sides[1], max_skew_s, problems)
        warnings = tuple[str, ...]()
    else:
        pairs = _by_frame(left_globs, right_globs, fps, problems)
        stamps_s = [stamp_in(left.path) for left, _ in pairs]
        warnings = replaced_rate(fps, sorted(filter(None, stamps_s))) if None not in stamps_s else ()
    return Recording(name, pairs, usual_size(name, pairs, problems), problems, warnings=warnings)


def _stamped(paths: Sequence[Path], times: Times | None, problems: list[Problem]) -> list[ImageFile]:
    """Images in the order of their stamps."""
    if times:
        return distinct_stamps(times.stamp([ImageFile(path, 0.0) for path in paths], problems), problems)
    stamps = {path: stamp_in(path) for path in paths}
    if unstamped := [path for path, stamp_s in stamps.items() if stamp_s is None]:
        expected = "--fps, --times, or stamps as names: s with a point, or 13 (ms), 16 (µs), 19 (ns) digits"
        raise InputError(unstamped[0], f"its name is no stamp; expected {expected}")
    return distinct_stamps([ImageFile(path, s) for path, s in stamps.items() if s is not None], problems)


def _by_frame(
    left_globs: Sequence[str], right_globs: Sequence[str], fps: float, problems: list[Problem]
) -> tuple[Pair, ...]:
    """Pairs of one number at a constant rate."""
    if not 0 < fps < float("inf"):
        raise InputError("recording", f"fps {fps}; expected a positive number of frames a second")
    left, right = (_by_number(_matched(patterns), problems) for patterns in (left_globs, right_globs))
    numbers = sorted(left | right)
    step = median_low([b - a for a, b in pairwise(numbers)] or [1])

    def files(paths: dict[int, Path]) -> list[ImageFile]:
        return [ImageFile(paths[n], (n - numbers[0]) / step / fps) for n in sorted(paths)]

    for mine, others, which in ((left, right, "right"), (right, left, "left")):
        paired = {place for place, n in enumerate(sorted(mine)) if n in others}
        note_unpaired(files(mine), paired, f"{which} image of the same number, by which --fps pairs", problems)
    common = left.keys() & right.keys()
    columns = [files({n: paths[n] for n in common}) for paths in (left, right)]
    return tuple(zip(*columns, strict=True))


def _matched(patterns: Sequence[str]) -> list[Path]:
    """The files that patterns, folders or names (where the shell expanded them) stand for, in natural order."""
    matched: dict[Path, Path] = {}
    for pattern in patterns:
        names = images_in(Path(pattern)) if Path(pattern).is_dir() else map(Path, glob(pattern, recursive=True))
        matched |= {name.absolute(): name for name in names}
    paths = [path for path in matched.values() if path.is_file()]
    if not paths:
        expected = "a folder or pattern of image files, such as 'left/*.png'"
        raise InputError(_briefly(patterns), f"matches no file; expected {expected}")
    return sorted(paths, key=natural_order)


def _by_number(paths: Sequence[Path], problems: list[Problem]) -> dict[int, Path]:
    """The files by their number; one without a number is noted."""
    numbered: dict[int, Path] = {}
    for path in paths:
        number = number_in(path)
        if number is None:
            reason = "no number in its name; expected one to pair it by"
            problems.append(Problem(ProblemKind.UNPAIRED, path, None, reason))
        elif number in numbered:
            raise InputError(path, f"number {number} again; expected each once, and {numbered[number]} has it")
        else:
            numbered[number] = path
    return numbered


def _briefly(patterns: Sequence[str]) -> str:
    """The first of what may be hundreds of names, where a shell expanded the pattern."""
    return patterns[0] + (f" (and {len(patterns) - 1} more)" if len(patterns) > 1 else "")
