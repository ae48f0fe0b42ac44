"""The source of a recording: the options of `pps_vision.open_recording` and of every command that reads
one.  Importing it loads no other module than what `--help` needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from pps_vision.errors import InputError, expect_kinds
from pps_vision.recordings import MAX_SKEW_S, CalibrationOptions, Layout, Lens, TimeUnit

if TYPE_CHECKING:
    from pps_vision.robot.robot_setup import RobotSetup

_SEVERAL = {"left", "right", "calib", "times"}
_FILES = {"joints", "taxels"}
Names = Sequence[Path | str] | Path | str
"""A name of a file, or several."""


@dataclass(frozen=True, kw_only=True)
class _Files:
    """The images and their calibration."""

    left: tuple[str, ...] = ()
    """Left images: a folder, a pattern in quotes such as 'seq/left*.png', or the files themselves; or a video.
    Of a ROS bag: the topic, where its name does not hold "left"."""
    right: tuple[str, ...] = ()
    """Right images, paired with the left ones by stamp, or with --fps by the last number in their names; or a video."""
    calib: tuple[Path, ...] = ()
    """Calibration of OpenCV, Kalibr, ROS, KITTI, EuRoC, aniposelib, … or by hand, in one file or several (left, right
    and stereo); for an iCub's REC without its own icubEyes.ini that file."""


@dataclass(frozen=True, kw_only=True)
class SourceOptions(CalibrationOptions, _Files):
    """Where the images are, and how they are read."""

    times: tuple[Path, ...] = ()
    """Stamps of the images, a row each, in one file or in one for the left and one for the right images: numbers or
    dates, alone or with the image's name (TUM, EuRoC's CSV)."""
    times_unit: TimeUnit | None = None
    """Unit of the stamps of --times; default: as their digits, their header or the video's own rate say."""
    fps: float | None = None
    """Frames per second; required where neither files nor names hold stamps.  It replaces those of images and videos,
    not those of an iCub, EuRoC or a ROS bag."""
    joints: Path | None = None
    """Offsets to add to the encoders of REC, as `pps-vision joints` writes them."""
    max_skew_s: float = MAX_SKEW_S
    """Left and right images further apart in time are no pair."""
    layout: Layout = "lr"
    """Where one video, or each image of a folder, shows both views: lr, the left camera's in its left half; rl; tb, in
    its upper half; bt."""
    squeezed: bool = False
    """Each half of such an image shows a whole image, squeezed to half its width (lr, rl) or height (tb, bt); the
    calibration is for whole images."""
    no_rotate: bool = False
    """Take videos as they were recorded, without the rotation that their headers state."""
    start_s: float = 0.0
    """Leave out what comes before, seconds from the first pair."""
    stop_s: float | None = None
    """Leave out what comes after, seconds from the first pair."""
    roi: tuple[int, int, int, int] | None = None
    """X Y W H: look at this part of both images only, top-left corner and size, pixels; the rest is taken as grey."""


class CalibrationArguments(TypedDict, total=False):
    """The fields of `CalibrationOptions` as a caller may give them."""

    unit_m: float
    cameras: tuple[str, str] | None
    lens: Lens | None
    crop: tuple[int, int] | None
    scaled: bool
    rectified: bool


class Options(CalibrationArguments, total=False):
    """The fields of `Source` as a caller may give them."""

    left: Names
    right: Names
    calib: Names
    times: Names
    times_unit: TimeUnit | None
    fps: float | None
    joints: Path | str | None
    max_skew_s: float
    layout: Layout
    squeezed: bool
    no_rotate: bool
    start_s: float
    stop_s: float | None
    roi: tuple[int, int, int, int] | None
    taxels: Path | str | None
    robot: "RobotSetup | Path | str | None"


@dataclass(frozen=True, kw_only=True)
class Source(SourceOptions):
    """Arguments of `pps_vision.open_recording`."""

    folder: Path | None = None
    """Folder of an iCub's recording in yarpdatadumper layout, as `render` writes it; an EuRoC or KITTI folder; a ROS
    bag; or a video or images with both views (--layout)."""
    taxels: Path | None = None
    """The robot's taxels*.ini, for a recording of its skin events."""
    robot: "RobotSetup | None" = None
    """Whose recording it is, also as the name of its robot.toml; default: an iCub."""


def make_source(folder: Path | str | None, options: Options) -> Source:
    """The source of these options; InputError for one of another type or out of its range, TypeError for an unknown
    one."""
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None and str(value)}
    expect_kinds("recording", {"folder": folder} | given, {"folder": Path | str | None} | Options.__annotations__)
    for name in _FILES & given.keys():
        given[name] = Path(given[name])
    for name in _SEVERAL & given.keys():
        names = (given[name],) if isinstance(given[name], Path | str) else given[name]
        given[name] = tuple(map(str if name in ("left", "right") else Path, names))
    if isinstance(robot := given.get("robot"), Path | str):
        from pps_vision.recordings.robot_file import read_robot

        given["robot"] = read_robot(Path(robot))
    source = Source(folder=None if folder is None else Path(folder), **given)
    expect_skew(source.max_skew_s)
    expect_rate(source.fps)
    return source


def expect_rate(fps: float | None) -> None:
    """InputError for what is given and cannot be a number of frames a second."""
    if fps is not None and not 0 < fps < float("inf"):
        raise InputError("recording", f"fps {fps}; expected a positive number of frames a second")


def expect_skew(max_skew_s: float) -> None:
    """InputError for what cannot be the largest difference of the stamps of a pair."""
    if not 0 <= max_skew_s < float("inf"):
        raise InputError("recording", f"max_skew_s {max_skew_s}; expected a finite time of at least 0 s")
