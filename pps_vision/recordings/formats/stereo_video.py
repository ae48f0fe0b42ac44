"""Two videos of a stereo camera, or one with both images side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import (
    check_options,
    matched,
    squeezed_aspect,
    times_of_sides,
    with_calibration,
)
from pps_vision.recordings.image_file import ImageFile, halves
from pps_vision.recordings.recording import (
    Recording,
    clocks_apart,
    pair_by_stamp,
    replaced_rate,
    usual_sizes,
    usual_step_s,
)
from pps_vision.recordings.source import Source
from pps_vision.recordings.video import VideoFrame, is_video, open_video
from pps_vision.recordings.warnings import Problem

FORMAT = "videos by --left and --right, or one with both images (--layout)"
_MORE = 2  # frames by which cameras that are stopped one after the other may differ


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    if source.folder is not None:
        return source.folder.is_file()
    return any(is_video(Path(name)) for name in (*source.left, *source.right))


def open_source(source: Source) -> Recording:
    """Open the videos, their frames paired by stamp; InputError if they or the calibration cannot be used."""
    check_options(source)
    times = times_of_sides(source)
    names = [(str(source.folder),)] if source.folder else [source.left, source.right]
    sides = [
        open_video(matched(side), source.fps, side_times, not source.no_rotate, by_field=True)
        for side, side_times in zip(names, times, strict=False)
    ]
    left: Sequence[ImageFile] = sides[0]
    right: Sequence[ImageFile] = sides[-1]
    video = sides[0][0].video
    aspect = video.pixel_aspect
    if source.folder is not None:
        left, right = halves(sides[0], source.layout)
        is_beside = source.layout in ("lr", "rl")
        side_px = video.image_size[0 if is_beside else 1]
        if side_px % 2:
            shape = f"is {side_px} pixels {'wide' if is_beside else 'high'}"
            raise InputError(source.folder, f"{shape}; expected two halves of one size (--layout)")
        aspect *= squeezed_aspect(source)
    problems: list[Problem] = []
    warnings = list(_ends_early(sides[0], sides[-1], source.max_skew_s))
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    if (source.fps or source.times) and video.has_stamps:
        own_s = [video.time_base_s * pts for pts in video.pts]
        fps = source.fps or 1 / (sides[0][0].fields * usual_step_s([frame.stamp_s for frame in sides[0]]) or 1.0)
        option = f"--times {source.times[0]} ({fps:.4g} frames/s)" if source.times else f"--fps {fps:g}"
        warnings += replaced_rate(option, fps, own_s)
    if not source.fps:
        warnings += clocks_apart(left, right, len(pairs), source.max_skew_s)
    size, right_size = usual_sizes(names[0][0], pairs, problems)
    notes = tuple(dict.fromkeys(note for side in sides for note in _notes(side[0])))
    recording = Recording(names[0][0], pairs, size, problems, warnings=tuple(warnings), notes=notes)
    recording = replace(recording, pixel_aspect=aspect, right_size=right_size)
    try:
        return with_calibration(recording, source.calib, source)
    except InputError as error:
        if video.turns:
            source_file, message, line = error.args
            turned = f"{video.path} is turned as its header says; --no-rotate takes it as it was recorded"
            raise InputError(source_file, f"{message}; {turned}", line) from error
        raise


def _notes(frame: VideoFrame) -> Iterator[str]:
    """How a video's frames are read."""
    video = frame.video
    if video.turns:
        degrees = {1: "90° anticlockwise", 2: "180°", 3: "90° clockwise"}[video.turns]
        yield f"{video.path}: images are turned by {degrees}, as its header says (--no-rotate: as recorded)"
    if frame.fields == 2:
        yield f"{video.path}: interlaced; each frame is read as two fields, the second half an interval later"
    if video.pixel_aspect != 1:
        yield f"{video.path}: pixels are {video.pixel_aspect:.4g} times as wide as high by its header"


def _ends_early(left: list[VideoFrame], right: list[VideoFrame], max_skew_s: float) -> Iterator[str]:
    """That one of the videos ends well before the other, or before the end that its header states."""
    short, long = sorted((left, right), key=lambda side: side[-1].stamp_s)
    end_s = short[-1].stamp_s
    more = sum(frame.stamp_s > end_s + max_skew_s for frame in long)
    if more > _MORE:
        yield f"{_ended(short)}; {long[0].path} has {more} more"
        return
    for side in {frames[0].path: frames for frames in (left, right)}.values():
        video = side[-1].video
        end_s = video.time_base_s * video.pts[-1] if video.has_stamps else np.inf
        if video.stated_s > end_s * (1 + (1 + _MORE) / len(side)):
            yield f"{_ended(side)}; its header states {video.stated_s:.2f} s"


def _ended(side: list[VideoFrame]) -> str:
    lasted_s = side[-1].stamp_s - side[0].stamp_s
    return f"{side[0].path} ends early ({len(side)} frames, {lasted_s:.2f} s)"
