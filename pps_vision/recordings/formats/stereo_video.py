"""Two videos of a stereo camera, or one with both images side by side."""

from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import check_options, fixed_rig
from pps_vision.recordings.problems import Problem
from pps_vision.recordings.recording import Recording, Source, pair_by_stamp, usual_size
from pps_vision.recordings.times import read_times
from pps_vision.recordings.video import is_video, open_halves, open_video

FORMAT = "two videos, or one of both images side by side, with calib"


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    if source.folder is not None:
        return source.folder.is_file()
    return any(is_video(Path(name)) for name in (*source.left, *source.right))


def open_source(source: Source) -> Recording:
    """Open the videos, their frames paired by stamp; InputError if they or the calibration cannot be used."""
    check_options(source)
    times = read_times(source.times) if source.times else None
    if source.folder is not None:
        name, (left, right) = str(source.folder), open_halves(source.folder, source.fps, times)
    else:
        if not (len(source.left) == len(source.right) == 1):
            raise InputError("recording", "expected one left and one right video")
        name = source.left[0]
        left, right = (open_video(Path(side[0]), source.fps, times) for side in (source.left, source.right))
    problems: list[Problem] = []
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    size = usual_size(name, pairs, problems)
    return Recording(name, pairs, size, problems, rig=fixed_rig(source.calib, size, source.unit_m))
