"""KITTI's odometry sequences: image_0 and image_1 (grey) or image_2 and image_3 (colour), times.txt, calib.txt."""

from dataclasses import replace
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import check_options, open_stereo_images, with_calibration
from pps_vision.recordings.recording import Recording, read_times
from pps_vision.recordings.source import Source

FORMAT = "a KITTI folder, image_0 and image_1 or image_2 and image_3 with times.txt and calib.txt"
_PAIRS = ((2, 3), (0, 1))


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is not None and any((source.folder / f"image_{k}").is_dir() for pair in _PAIRS for k in pair)


def open_source(source: Source) -> Recording:
    """Open `source.folder`, in colour where it has both; InputError if its images or its calibration cannot be used."""
    check_options(source)
    folder = Path(str(source.folder))
    cameras = next((pair for pair in _PAIRS if all((folder / f"image_{k}").is_dir() for k in pair)), None)
    if cameras is None:
        raise InputError(folder, "images of one camera only; expected image_2 and image_3, or image_0 and image_1")
    left, right = ([str(folder / f"image_{camera}")] for camera in cameras)
    stamps = folder / "times.txt"
    own = folder / "calib.txt"
    times = None if source.fps else read_times(source.times or stamps)
    recording = open_stereo_images(left, right, source.fps, times, source.max_skew_s)
    replaced = (f"--fps {source.fps:g} replaces the stamps of {stamps}",) if source.fps and stamps.exists() else ()
    recording = replace(recording, name=str(folder), warnings=(*recording.warnings, *replaced))
    if not (source.calib or own.exists()):
        return replace(recording, calibration_at=f"{own}, or one by --calib")
    return with_calibration(recording, source.calib or [own], source, (left, right))
