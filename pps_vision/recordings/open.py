"""Open a recording, whatever its format: `pps_vision.open_recording`.

A format is a module of `pps_vision.recordings.formats` with `FORMAT`, its description, `recognises(source)` and
`open_source(source)`; it is found there without being named here.  `HAS_STAMPS` says that its stamps are always its
own, `TAKES_TOPICS` that left and right are topics, `IS_ROBOT` that the cameras are a robot's.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Unpack

from pps_vision.errors import InputError
from pps_vision.recordings import formats
from pps_vision.recordings.image_file import Half
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.source import CalibrationArguments, Options, Source, make_source
from pps_vision.recordings.tables import read_joint_offsets


def open_recording(folder: Path | str | None = None, **options: Unpack[Options]) -> Recording:
    """Open the recording of an iCub, an EuRoC or KITTI folder, videos, or any stereo images with a calibration.

    Iterating the recording decodes its frames one at a time; it also holds `rig`, `robot`, `touches`, `truth` and
    `problems` (rows and images that were skipped, with reasons).

    Args:
        folder: Folder of an iCub's recording in yarpdatadumper layout, as `render` writes it; an EuRoC or KITTI folder;
            a ROS bag; or a video with the left image in its left half.
        options: The other fields of `Source`: `left` and `right` instead of `folder` (each a name or several), `calib`
            (one file or several; without any the recording has no `rig` and cannot be tracked), `times`, `fps`, …

    Raises:
        InputError: Nothing usable is there; names the file, the line and the expected content.
    """
    source = make_source(folder, options)
    if folder in (None, "") and not source.left and not source.right:
        raise InputError("recording", "expected either REC, or left and right images or videos with calib")
    if source.folder is not None and not source.folder.exists():
        raise InputError(source.folder, "no such file or folder; expected a recording, or a side-by-side video")
    names = sorted(module.name for module in iter_modules(formats.__path__))
    modules = [import_module(f"{formats.__name__}.{name}") for name in names]
    module = next((module for module in modules if module.recognises(source)), None)
    if source.folder is not None and (source.left or source.right) and not getattr(module, "TAKES_TOPICS", False):
        raise InputError("recording", "expected either REC, or left and right images or videos with calib")
    if module is None:
        is_empty = source.folder is not None and source.folder.is_dir() and not any(source.folder.iterdir())
        reason = "an empty folder" if is_empty else "no recording"
        raise InputError(str(source.folder), f"{reason}; expected {'; or '.join(module.FORMAT for module in modules)}")
    recording: Recording = module.open_source(source)
    if source.joints and recording.robot:
        offsets_rad = read_joint_offsets(source.joints, recording.robot.joint_names)
        recording = recording.with_joint_offsets(offsets_rad)
    warnings = (*recording.warnings, *_unused(source, module, isinstance(recording.pairs[0][0], Half)))
    return replace(recording.part(source.start_s, source.stop_s, source.roi), unit_m=source.unit_m, warnings=warnings)


def _unused(source: Source, module: ModuleType, shows_both: bool) -> Iterator[str]:
    """Warnings of options that say nothing about this recording; `shows_both`: one image shows both views."""
    unused: dict[str, Iterable[str]] = {
        f"{source.folder} has stamps of its own": ("fps", "times") if hasattr(module, "HAS_STAMPS") else (),
        "without --times": () if source.times else ("times_unit",),
        "no image shows both views": () if shows_both else ("layout", "squeezed"),
        "the cameras are a robot's": CalibrationArguments.__annotations__ if hasattr(module, "IS_ROBOT") else (),
    }
    for reason, names in unused.items():
        if given := [f"--{n.replace('_', '-')}" for n in names if getattr(source, n) != getattr(Source, n)]:
            yield f"{' and '.join(given)} not used: {reason}"
