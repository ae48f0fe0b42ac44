"""KITTI's odometry sequences: image_0 and image_1 (grey) or image_2 and image_3 (colour), times.txt, calib.txt; and its
raw drives: image_00 to image_03, each with data and timestamps.txt, and calib_cam_to_cam.txt beside the drive."""

from dataclasses import replace
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import (
    check_options,
    open_stereo_images,
    times_of_sides,
    with_calibration,
)
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.source import Source

FORMAT = "a KITTI folder, image_0 and image_1 or image_2 and image_3 with times.txt and calib.txt, or a raw drive"
_PAIRS = (("image_2", "image_3"), ("image_0", "image_1"), ("image_02", "image_03"), ("image_00", "image_01"))


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is not None and any((source.folder / name).is_dir() for pair in _PAIRS for name in pair)


def open_source(source: Source) -> Recording:
    """Open `source.folder`, in colour where it has both; InputError if its images or its calibration cannot be used."""
    check_options(source)
    folder = Path(str(source.folder))
    cameras = next((pair for pair in _PAIRS if all((folder / name).is_dir() for name in pair)), None)
    if cameras is None:
        raise InputError(folder, "images of one camera only; expected image_2 and image_3, or image_0 and image_1")
    if cameras in _PAIRS[2:]:  # a raw drive
        left, right = ([str(folder / camera / "data")] for camera in cameras)
        stamps = [folder / camera / "timestamps.txt" for camera in cameras]
        own = folder.absolute().parent / "calib_cam_to_cam.txt"
    else:
        left, right = ([str(folder / camera)] for camera in cameras)
        stamps = [folder / "times.txt"]
        own = folder / "calib.txt"
    times = times_of_sides(source if source.times or source.fps else replace(source, times=tuple(stamps)))
    recording = open_stereo_images(left, right, source.fps, times, source.max_skew_s)
    has_stamps = source.fps and stamps[0].exists()
    replaced = (f"--fps {source.fps:g} replaces the stamps of {stamps[0]}",) if has_stamps else ()
    recording = replace(recording, name=str(folder), warnings=(*recording.warnings, *replaced))
    if not (source.calib or own.exists()):
        return replace(recording, calibration_at=f"{own}, or one by --calib")
    return with_calibration(recording, source.calib or [own], source, (left, right))
