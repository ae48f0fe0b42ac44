"""Open a recording, whatever its format: `pps_vision.open_recording`.

A format is a module of `pps_vision.recordings.formats` with `FORMAT`, its description, `recognises(source)` and
`open_source(source)`; it is found there without being named here.  `HAS_STAMPS` says that its stamps are always its
own, `TAKES_TOPICS` that left and right are topics.
"""

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from pps_vision.errors import InputError
from pps_vision.recordings import MAX_SKEW_S, formats
from pps_vision.recordings.recording import Recording, Source

if TYPE_CHECKING:
    from pps_vision.robot.robot_setup import RobotSetup


def open_recording(
    folder: Path | str | None = None,
    *,
    left: Sequence[Path | str] | Path | str = (),
    right: Sequence[Path | str] | Path | str = (),
    calib: Sequence[Path | str] | Path | str = (),
    times: Path | str | None = None,
    fps: float | None = None,
    unit_m: float = 1.0,
    joints: Path | str | None = None,
    taxels: Path | str | None = None,
    max_skew_s: float = MAX_SKEW_S,
    robot: "RobotSetup | None" = None,
) -> Recording:
    """Open the recording of an iCub, an EuRoC or KITTI folder, videos, or any stereo images with a calibration.

    Iterating the recording decodes its frames one at a time; it also holds `rig`, `robot`, `touches`, `truth` and
    `problems` (rows and images that were skipped, with reasons).

    Args:
        folder: Folder of an iCub's recording in yarpdatadumper layout, as `render` writes it; an EuRoC or KITTI folder;
            a ROS bag; or a video with the left image in its left half.
        left: Instead of `folder`: left images as a folder, a pattern such as "seq/left*.png", or several; or a video.
            With a ROS bag: the topic of the left images.
        right: Right images, paired with the left ones by stamp, or with `fps` by the last number in their names.
        calib: Calibration of `left` and `right` of OpenCV, Kalibr, ROS, KITTI, EuRoC or aniposelib, a file or several;
            in place of the one in `folder`.  Without any the recording has no `rig` and cannot be tracked.
        times: Stamps of the images, a row each: s, "stamp name" (TUM), or EuRoC's CSV in ns.
        fps: Frames per second, where neither files nor names hold stamps, or instead of these (not in the recordings of
            an iCub, EuRoC folders and ROS bags).
        unit_m: Metres per length unit of the calibration.
        joints: Offsets to add to the encoders, as `pps-vision joints` writes them.
        taxels: The robot's taxels*.ini, for a recording of its skin events.
        max_skew_s: Left and right images further apart in time are no pair.
        robot: Whose recording it is; default: an iCub.

    Raises:
        InputError: Nothing usable is there; names the file, the line and what was expected.
    """
    if folder in (None, "") and not left and not right:
        raise InputError("recording", "expected either REC, or left and right images or videos with calib")
    source = Source(
        folder=None if folder is None else Path(folder),
        left=_several(left),
        right=_several(right),
        calib=tuple(map(Path, _several(calib))),
        times=Path(times) if times else None,
        fps=fps,
        unit_m=unit_m,
        joints=Path(joints) if joints else None,
        taxels=Path(taxels) if taxels else None,
        max_skew_s=max_skew_s,
        robot=robot,
    )
    if source.folder is not None and not source.folder.exists():
        raise InputError(source.folder, "no such file or folder; expected a recording, or a side-by-side video")
    names = sorted(module.name for module in iter_modules(formats.__path__))
    modules = [import_module(f"{formats.__name__}.{name}") for name in names]
    module = next((module for module in modules if module.recognises(source)), None)
    if source.folder is not None and (left or right) and not getattr(module, "TAKES_TOPICS", False):
        raise InputError("recording", "expected either REC, or left and right images or videos with calib")
    if module is None:
        is_empty = source.folder is not None and source.folder.is_dir() and not any(source.folder.iterdir())
        reason = "an empty folder" if is_empty else "no recording"
        raise InputError(str(source.folder), f"{reason}; expected {'; or '.join(module.FORMAT for module in modules)}")
    recording: Recording = module.open_source(source)
    unused = [f"--{name}" for name in ("fps", "times") if getattr(source, name) is not None]
    if unused and getattr(module, "HAS_STAMPS", False):
        warning = f"{' and '.join(unused)} not used: {source.folder} has stamps of its own"
        recording = replace(recording, warnings=(*recording.warnings, warning))
    return replace(recording, unit_m=source.unit_m)


def _several(paths: Sequence[Path | str] | Path | str) -> tuple[str, ...]:
    """One name, or several."""
    return (str(paths),) if isinstance(paths, Path | str) else tuple(map(str, paths))
