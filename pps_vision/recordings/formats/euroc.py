"""EuRoC's and other ASL folders: mav0/cam0 and cam1, each with data.csv, sensor.yaml and its images in data."""

from dataclasses import replace
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import refuse_robot_options, with_calibration
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.recording import Recording, pair_by_stamp, usual_sizes
from pps_vision.recordings.source import Source
from pps_vision.recordings.times import read_times
from pps_vision.recordings.warnings import Problem

FORMAT = "a EuRoC folder, mav0/cam0 and cam1 with a data.csv each"
HAS_STAMPS = True


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is not None and any((camera / "data.csv").exists() for camera in _cameras(source.folder))


def open_source(source: Source) -> Recording:
    """Open `source.folder`; InputError if its images or its calibration cannot be used."""
    refuse_robot_options(source)
    folder = Path(str(source.folder))
    problems = list[Problem]()
    cameras = _cameras(folder)
    if lacking := [camera for camera in cameras if not (camera / "data.csv").exists()]:
        raise InputError(lacking[0], "no data.csv; expected both cameras, cam0 and cam1, with a data.csv each")
    left, right = (_images(camera) for camera in cameras)
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    size, right_size = usual_sizes(folder, pairs, problems)
    recording = Recording(str(folder), pairs, size, problems, right_size=right_size)
    own = [camera / "sensor.yaml" for camera in cameras]
    if not source.calib and (missing := [file for file in own if not file.exists()]):
        return replace(recording, calibration_at=f"{missing[0]}, or two by --calib")
    return with_calibration(recording, source.calib or own, source)


def _cameras(folder: Path) -> list[Path]:
    place = folder / "mav0" if (folder / "mav0").is_dir() else folder
    return [place / "cam0", place / "cam1"]


def _images(camera: Path) -> list[ImageFile]:
    times = read_times(camera / "data.csv")
    if not times.names:
        raise InputError(times.file, "names no image; expected rows of stamp and the name of an image")
    entries = zip(times.names, times.seconds(), strict=True)
    return [ImageFile(camera / "data" / name, stamp_s) for name, stamp_s in entries]
