"""Frames of a video file with the file's own stamps, decoded one at a time; the frames of one camera."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame as Decoded

from pps_vision.errors import InputError, first_line
from pps_vision.files import check_regular
from pps_vision.recordings.image_file import MOST_PIXELS, ImageFile, decode, images_in
from pps_vision.recordings.recording import Times
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Image

_SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".ts")
# No playlists, whose files could be any on this machine or beyond.
_CONTAINERS = {"format_whitelist": "mov,mp4,matroska,webm,avi,mpeg,mpegts", "protocol_whitelist": "file"}
_FAR = 100  # frames ahead: seeking is faster than decoding what lies between


class Video:
    """A video file and how far it is decoded: the next frame costs one frame, one far ahead or before a seek.

    Attributes:
        path: The file.
        image_size: Width and height.
        pts: The frames' stamps in order, in units of `time_base_s`; without `has_stamps` they are counted instead.
        time_base_s: Seconds per unit of `pts`.
        stated_s: Its duration by the header, where this is known to be that of the images; else 0.
    """

    def __init__(self, path: Path) -> None:
        check_regular(path, "a video")
        self.path = path
        try:
            with self._open() as container:
                stream = container.streams.video[0]
                if stream.codec_context is None:
                    raise ValueError("no decoder for it")
                pts = [packet.pts for packet in container.demux(stream) if packet.size and not packet.is_discard]
                self.image_size = stream.codec_context.width, stream.codec_context.height
                self.time_base_s = float(stream.time_base or 0)
                # What Matroska's header says; the others' may be that of the sound, or estimated.
                states_it = "matroska" in container.format.name and len(container.streams) == 1
                self.stated_s = (container.duration or 0) / 1e6 if states_it else 0.0
        except (av.error.FFmpegError, IndexError, ValueError, MemoryError) as error:
            damaged = isinstance(error, av.error.InvalidDataError)
            reason = "it is damaged, cut off or no video" if damaged else first_line(error)
            raise InputError(path, f"cannot be read: {reason}; expected a whole video") from error
        if not pts or min(self.image_size) < 1 or self.image_size[0] * self.image_size[1] > MOST_PIXELS:
            width, height = self.image_size
            reason = f"{len(pts)} frames of {width}×{height} pixels"
            raise InputError(path, f"{reason}; expected frames of at most {MOST_PIXELS} pixels")
        stamps = sorted({stamp for stamp in pts if stamp is not None})
        self.has_stamps = len(stamps) == len(pts) and self.time_base_s > 0
        self.pts = stamps if self.has_stamps else list(range(len(pts)))
        self._place = {pts: index for index, pts in enumerate(self.pts)}
        self._frames: Iterator[tuple[int, Decoded]] = iter(())
        self._last: tuple[int, Image | str] = len(self.pts), ""  # index of the frame that was decoded last

    def _open(self) -> InputContainer:
        return av.open(str(self.path), options=_CONTAINERS)

    def load(self, index: int) -> Image | str:
        """Return a frame as RGB uint8, or the reason why there is none."""
        at = self._last[0]
        if index < at or (self.has_stamps and index > at + _FAR):
            self._frames = self._decoded(index)
            at = -1
        try:
            while at < index:
                at, frame = next(self._frames)
                is_whole = (frame.width, frame.height) == self.image_size
                wrong = f"is {frame.width}×{frame.height} pixels"
                self._last = at, np.asarray(frame.to_ndarray(format="rgb24"), np.uint8) if is_whole else wrong
        except StopIteration:  # as for all that come after it
            self._last = index, "is missing"
        except (av.error.FFmpegError, OSError, ValueError, MemoryError) as error:
            self._last = index, f"cannot be decoded ({first_line(error)})"
        return self._last[1] if self._last[0] == index else "is missing"

    def _decoded(self, index: int) -> Iterator[tuple[int, Decoded]]:
        """Frames with their indices, from a key frame before one; what cannot be decoded is left out."""
        with self._open() as container:
            stream = container.streams.video[0]
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            if self.has_stamps and index > _FAR:
                container.seek(self.pts[index - _FAR // 2], stream=stream)
            count = -1
            for packet in container.demux(stream):
                with suppress(av.error.InvalidDataError):
                    for frame in packet.decode():
                        count += 1
                        at = self._place.get(frame.pts) if self.has_stamps and frame.pts is not None else count
                        if at is not None:
                            yield at, frame


@dataclass(frozen=True, slots=True)
class VideoFrame(ImageFile):
    """One frame of a video, or one half of it."""

    video: Video = field(repr=False, compare=False, kw_only=True)
    part: str = field(default="whole", kw_only=True)

    @property
    def title(self) -> str:
        """What reports call it."""
        return f"frame {self.index}"

    def load(self) -> Image | str:
        """The image as RGB uint8, or the reason why there is none."""
        image = self.video.load(self.index)
        if isinstance(image, str) or self.part == "whole":
            return image
        half = image.shape[1] // 2
        return np.ascontiguousarray(image[:, :half] if self.part == "left" else image[:, half:])


def is_video(path: Path) -> bool:
    """Whether a file is called as videos are."""
    return path.suffix.lower() in _SUFFIXES and not path.is_dir()


def open_video(file: Path, fps: float | None, times: Times | None = None, part: str = "whole") -> list[VideoFrame]:
    """All frames of a video, with the stamps of `times`, of a constant rate `fps`, or else the file's own.

    InputError if there is no video, or it has no stamps and none are given.
    """
    video = Video(file)
    if times and times.names:
        raise InputError(times.file, f"names images; expected a stamp for each frame of {file.name}, without names")
    if not (fps or times or video.has_stamps):
        raise InputError(file, "not every frame has a stamp of its own; expected --fps or --times with this file")
    step_s = 1 / fps if fps else video.time_base_s
    steps = range(len(video.pts)) if fps else video.pts
    frames = [VideoFrame(file, step * step_s, video=video, index=index, part=part) for index, step in enumerate(steps)]
    return times.stamp(frames, []) if times else frames


def open_halves(file: Path, fps: float | None, times: Times | None = None) -> tuple[list[VideoFrame], list[VideoFrame]]:
    """The left and the right half of all frames of a side-by-side video; InputError for an odd width."""
    left = open_video(file, fps, times, part="left")
    if left[0].video.image_size[0] % 2:
        raise InputError(file, f"is {left[0].video.image_size[0]} pixels wide; expected two halves of one width")
    right = [VideoFrame(file, f.stamp_s, video=f.video, index=f.index, part="right") for f in left]
    return left, right


@dataclass(frozen=True)
class ImageSequence:
    """One camera's frames in natural order; iterating yields (frame, image), the first file being 1."""

    files: tuple[ImageFile, ...]
    image_size: tuple[int, int]  # width, height
    problems: list[Problem]  # from the last iteration

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[tuple[int, Image]]:
        self.problems.clear()
        for frame, file in enumerate(self.files, start=1):
            image = decode(file, self.image_size)
            if isinstance(image, Problem):
                self.problems.append(image)
            else:
                yield frame, image


def open_frames(folder: Path) -> ImageSequence:
    """The images of a folder in natural order, or of a video; InputError if none is readable."""
    files: tuple[ImageFile, ...]
    if is_video(folder):
        files = tuple(open_video(folder, fps=1.0))
    elif folder.is_dir():
        files = tuple(ImageFile(path, 0.0) for path in images_in(folder))
    else:
        reason = "is no folder and no video" if folder.exists() else "no such folder"
        raise InputError(folder, f"{reason}; expected a folder with the frames of a sequence, or a video")
    first = next((image for image in map(decode, files) if not isinstance(image, Problem)), None)
    if first is None:
        raise InputError(folder, f"no usable frame among {len(files)} images; expected files such as 0001.png")
    return ImageSequence(files, (first.shape[1], first.shape[0]), [])
