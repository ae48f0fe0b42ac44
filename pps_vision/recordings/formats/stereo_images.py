"""Image files of a stereo camera, paired by their stamps or the numbers in their names, with a calibration."""

from collections.abc import Sequence
from dataclasses import replace
from glob import glob
from itertools import pairwise
from pathlib import Path
from statistics import median_low

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings import MAX_SKEW_S, Layout
from pps_vision.recordings.image_file import (
    Half,
    ImageFile,
    Page,
    halves,
    images_in,
    images_of,
    natural_order,
    orientation_of,
    stamp_in,
)
from pps_vision.recordings.recording import (
    Pair,
    Recording,
    clocks_apart,
    distinct_stamps,
    note_unpaired,
    pair_by_stamp,
    replaced_rate,
    usual_sizes,
)
from pps_vision.recordings.source import Source
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.times import Times, read_times
from pps_vision.recordings.video import is_video
from pps_vision.recordings.warnings import Problem, ProblemKind

FORMAT = "images by --left and --right, or a folder of images that show both (--layout)"


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    if source.folder is not None:
        return source.folder.is_dir() and not (source.folder / "data.log").exists() and bool(images_in(source.folder))
    return not any(is_video(Path(name)) for name in (*source.left, *source.right))


def open_source(source: Source) -> Recording:
    """Open the images `source.left` and `source.right`, or the halves of the images in `source.folder`.

    InputError if they or the calibration cannot be used."""
    check_options(source)
    left, right, layout = source.left, source.right, None
    if source.folder is not None:
        left = right = (str(source.folder),)
        layout = source.layout
    times = times_of_sides(source)
    recording = open_stereo_images(left, right, source.fps, times, source.max_skew_s, layout)
    recording = replace(recording, pixel_aspect=squeezed_aspect(source) if layout else 1.0)
    return with_calibration(recording, source.calib, source)


def with_calibration(
    recording: Recording,
    calib: Sequence[Path],
    source: Source,
    images: tuple[Sequence[str], Sequence[str]] | None = None,
) -> Recording:
    """The recording with the cameras of a calibration, if one is given; `images`: the paths of both sides, by default
    as given.

    Where the files' pixels are not square, the calibration is for their images or for the same with square pixels.
    """
    if not calib:
        return recording
    recorded = recording.image_sizes
    square = _square(recorded[0], recording.pixel_aspect), _square(recorded[1], recording.pixel_aspect)
    errors: list[InputError] = []
    for size, right_size in [square, recorded] if source.squeezed else dict.fromkeys([recorded, square]):
        try:
            left, right, T_left_right = read_stereo_calibration(
                calib, size, source, images or (source.left, source.right), right_size
            )
        except InputError as error:
            errors.append(error)
            continue
        rig = StereoRig.fixed(left.stretched(*recorded[0]), right.stretched(*recorded[1]), T_left_right)
        return replace(recording, rig=rig)
    if isinstance(half := recording.pairs[0][0], Half):
        _refuse_one_camera(source, half, recording.image_size)
    raise errors[0]


def _refuse_one_camera(source: Source, half: Half, size: tuple[int, int]) -> None:
    """Raise InputError for images, with halves of this size, whose calibration is for the whole."""
    width, height = size
    try:
        read_stereo_calibration(source.calib, (2 * width, height) if half.axis else (width, 2 * height), source)
    except InputError:
        return
    reason = f"its whole frames are as large as the images of {source.calib[0]}, not their halves"
    expected = "both images side by side, or two videos or folders by --left and --right; --squeezed if each half is a"
    raise InputError(str(source.folder), f"{reason}; expected {expected} whole image")


def squeezed_aspect(source: Source) -> float:
    """Width of a pixel relative to its height, in halves of images whose pixels are square."""
    return (2.0 if source.layout in ("lr", "rl") else 0.5) if source.squeezed else 1.0


def _square(size: tuple[int, int], aspect: float) -> tuple[int, int]:
    """Width and height of the same images with square pixels."""
    width, height = size
    return (round(width * aspect), height) if aspect > 1 else (width, round(height / aspect))


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


def times_of_sides(source: Source) -> tuple[Times | None, Times | None]:
    """The stamps of `--times` for the left and the right images; InputError for more than two files."""
    if len(source.times) > 2:
        raise InputError("recording", f"{len(source.times)} files of times; expected one, or one for each side")
    times = [read_times(file, source.times_unit) for file in source.times]
    return (times[0], times[-1]) if times else (None, None)


def open_stereo_images(
    left_globs: Sequence[str],
    right_globs: Sequence[str],
    fps: float | None = None,
    times: tuple[Times | None, Times | None] = (None, None),
    max_skew_s: float = MAX_SKEW_S,
    layout: Layout | None = None,
) -> Recording:
    """Two sequences of one stereo camera, or with a `layout` one, whose images show both views.

    With `fps` they are paired by the last number in each file's name, which counts frames, so that a missing one leaves
    a gap in the stamps.  Else the images are paired by their stamps, from `times` or from their names.
    Unpaired images are noted in `problems`.  InputError if a pattern matches nothing, one number comes twice, or the
    images have no stamps.
    """
    problems: list[Problem] = []
    name = _briefly(left_globs)
    left: Sequence[ImageFile] = images_of(matched(left_globs))
    left, right = halves(left, layout) if layout else (left, images_of(matched(right_globs)))
    if fps is None:
        sides = [_stamped(*side, problems) for side in zip((left, right), times, strict=True)]
        pairs = pair_by_stamp(sides[0], sides[1], max_skew_s, problems)
        warnings = tuple(clocks_apart(sides[0], sides[1], len(pairs), max_skew_s)) if all(sides) else ()
    else:
        pairs, warnings = _by_frame(left, right, fps, problems)
        stamps_s = [stamp_in(image.path) for image, _ in pairs]
        if None not in stamps_s:
            warnings += replaced_rate(f"--fps {fps:g}", fps, sorted(filter(None, stamps_s)))
    turned = orientation_of(left[0].path) != 1
    notes = (f"{left[0].path}: its orientation (EXIF) is ignored: images are as recorded",) if turned else ()
    size, right_size = usual_sizes(name, pairs, problems)
    return Recording(name, pairs, size, problems, warnings=warnings, notes=notes, right_size=right_size)


def _stamped(images: Sequence[ImageFile], times: Times | None, problems: list[Problem]) -> list[ImageFile]:
    """Images in the order of their stamps."""
    if times:
        return distinct_stamps(times.stamp(list(images), problems), problems)
    stamped = []
    for image in images:
        if (stamp_s := stamp_in(image.path)) is None or isinstance(image, Page):
            names = "s with a point, 13 (ms), 16 (µs) or 19 (ns) digits, or a time of day with milliseconds"
            reason = "is a stack without stamps" if isinstance(image, Page) else "its name is no stamp"
            raise InputError(image.path, f"{reason}; expected --fps, --times, or stamps as names: {names}")
        stamped.append(replace(image, stamp_s=stamp_s))
    return distinct_stamps(stamped, problems)


def _by_frame(
    left_images: Sequence[ImageFile], right_images: Sequence[ImageFile], fps: float, problems: list[Problem]
) -> tuple[tuple[Pair, ...], tuple[str, ...]]:
    """Pairs of one number at a constant rate, and a warning where as many numbers of both sides begin and end equally
    far apart."""
    left, right = (_by_number(images, problems) for images in (left_images, right_images))
    numbers = sorted(left | right)
    apart = {max(right) - max(left), min(right) - min(left)} if left and right else {0}
    warning = (
        f"the numbers of the right images begin and end {max(apart):+d} from the left ones: if both cameras began "
    )
    warning += "together, number them alike, since --fps pairs equal numbers"
    warnings = (warning,) if len(left) == len(right) and len(apart) == 1 and 0 not in apart else ()
    step = median_low([b - a for a, b in pairwise(numbers)] or [1])

    def files(images: dict[int, ImageFile]) -> list[ImageFile]:
        return [replace(images[n], stamp_s=(n - numbers[0]) / step / fps) for n in sorted(images)]

    for mine, others, which in ((left, right, "right"), (right, left, "left")):
        paired = {place for place, n in enumerate(sorted(mine)) if n in others}
        note_unpaired(files(mine), paired, f"{which} image of the same number, by which --fps pairs", problems)
    common = left.keys() & right.keys()
    columns = [files({n: images[n] for n in common}) for images in (left, right)]
    if warnings and not common:
        raise InputError(right_images[0].path, f"no image of the number of a left one; {warning}")
    return tuple(zip(*columns, strict=True)), warnings


def matched(patterns: Sequence[str]) -> list[Path]:
    """The files that patterns, folders or names (where the shell expanded them) stand for, in natural order."""
    matched: dict[Path, Path] = {}
    for pattern in patterns:
        named = glob(pattern, recursive=True) or [pattern]  # a name may hold brackets
        names = images_in(Path(pattern)) if Path(pattern).is_dir() else map(Path, named)
        matched |= {name.absolute(): name for name in names}
    paths = [path for path in matched.values() if path.is_file()]
    if not paths:
        expected = "a folder or pattern of image files, such as 'left/*.png'"
        raise InputError(_briefly(patterns), f"matches no file; expected {expected}")
    return sorted(paths, key=natural_order)


def _by_number(images: Sequence[ImageFile], problems: list[Problem]) -> dict[int, ImageFile]:
    """The images by their number; one without a number is noted."""
    numbered: dict[int, ImageFile] = {}
    for image in images:
        if (number := image.number) is None:
            reason = "no number in its name; expected one to pair it by"
            problems.append(Problem(ProblemKind.UNPAIRED, image.path, None, reason))
        elif number in numbered:
            first = numbered[number].path
            raise InputError(image.path, f"number {number} again; expected each once, and {first} has it")
        else:
            numbered[number] = image
    return numbered


def _briefly(patterns: Sequence[str]) -> str:
    """The first of what may be hundreds of names, where a shell expanded the pattern."""
    return patterns[0] + (f" (and {len(patterns) - 1} more)" if len(patterns) > 1 else "")
