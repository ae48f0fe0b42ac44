"""Image files of a stereo camera, paired by the numbers in their names, with an OpenCV calibration."""

from collections.abc import Sequence
from dataclasses import replace
from glob import glob
from itertools import pairwise
from pathlib import Path
from statistics import median_low

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.image_file import ImageFile, number_in
from pps_vision.recordings.image_sequence import natural_order
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.recordings.recording import Recording, Source, note_unpaired, usual_size
from pps_vision.recordings.stereo_calibration import read_stereo_calibration

FORMAT = "left and right images with calib"
_BASELINE_M = (1e-5, 1e4)  # of any two cameras; products of larger or smaller numbers leave the range of doubles


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is None


def open_source(source: Source) -> Recording:
    """Open the images `source.left` and `source.right`; InputError if they or the calibration cannot be used."""
    if source.joints:
        raise InputError(
            "recording", f"joints {source.joints} with left and right images; expected it with a folder REC"
        )
    if not (source.left and source.right and source.calib):
        raise InputError("recording", "left, right and calib go together; one is missing")
    if source.fps is None:
        raise InputError("recording", "left and right images without fps; expected their number a second")
    recording = open_stereo_images(source.left, source.right, source.fps)
    cameras = read_stereo_calibration(source.calib, recording.image_size, source.unit_m)
    baseline_m = float(np.max(np.abs(cameras[2][:3, 3])))
    if not _BASELINE_M[0] <= baseline_m <= _BASELINE_M[1]:
        raise InputError(source.calib[-1], f"the cameras are {baseline_m:.3g} m apart; expected 0.01 mm to 10 km")
    return replace(recording, rig=StereoRig.fixed(*cameras))


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
    return Recording(name, pairs, usual_size(name, pairs, problems), problems)


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
