"""Two videos of a stereo camera, or one with both images side by side."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import check_options, with_calibration
from pps_vision.recordings.recording import Recording, pair_by_stamp, read_times, replaced_rate, usual_size
from pps_vision.recordings.source import Source
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.video import VideoFrame, is_video, open_halves, open_video
from pps_vision.recordings.warnings import Problem

FORMAT = "two videos by --left and --right, or one with both images side by side"
_MORE = 2  # frames by which cameras that are stopped one after the other may differ


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
        name = str(source.folder)
        (left, right) = open_halves(source.folder, source.fps, times)
    else:
        if not (len(source.left) == len(source.right) == 1):
            raise InputError("recording", "expected one left and one right video")
        name = source.left[0]
        left, right = (open_video(Path(side[0]), source.fps, times) for side in (source.left, source.right))
    problems: list[Problem] = []
    warnings = list(_ends_early(left, right, source.max_skew_s))
    video = left[0].video
    if source.fps and video.has_stamps:
        warnings += replaced_rate(source.fps, [video.time_base_s * pts for pts in video.pts])
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    size = usual_size(name, pairs, problems)
    try:
        return with_calibration(Recording(name, pairs, size, problems, warnings=tuple(warnings)), source.calib, source)
    except InputError:
        if source.folder is not None:
            _refuse_one_camera(source, (2 * size[0], size[1]))
        raise


def _refuse_one_camera(source: Source, size: tuple[int, int]) -> None:
    """Raise InputError for a video whose calibration is for its whole frames of this size: that of one camera."""
    try:
        read_stereo_calibration(source.calib, size, source.unit_m)
    except InputError:
        return
    reason = f"its whole frames are as large as the images of {source.calib[0]}, not their halves"
    expected = "both images side by side, or two videos by --left and --right"
    raise InputError(str(source.folder), f"{reason}; expected {expected}")


def _ends_early(left: list[VideoFrame], right: list[VideoFrame], max_skew_s: float) -> Iterator[str]:
    """That one of the videos ends well before the other, or before the end that its header states."""
    short, long = sorted((left, right), key=lambda side: side[-1].stamp_s)
    end_s = short[-1].stamp_s
    more = sum(frame.stamp_s > end_s + max_skew_s for frame in long)
    if more > _MORE:
        yield f"{_ended(short)}; {long[0].path} has {more} more"
        return
    for side in {frames[0].path: frames for frames in (left, right)}.values():
        video = side[0].video
        end_s = video.time_base_s * video.pts[-1] if video.has_stamps else np.inf
        if video.stated_s > end_s * (1 + (1 + _MORE) / len(side)):
            yield f"{_ended(side)}; its header states {video.stated_s:.2f} s"


def _ended(side: list[VideoFrame]) -> str:
    lasted_s = side[-1].stamp_s - side[0].stamp_s
    return f"{side[0].path} ends early ({len(side)} frames, {lasted_s:.2f} s)"
