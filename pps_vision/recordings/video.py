"""Frames of a video file with the file's own stamps, decoded one at a time; the frames of one camera."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import local

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame as Decoded
from av.video.reformatter import VideoReformatter

from pps_vision.errors import InputError, first_line
from pps_vision.files import check_regular
from pps_vision.recordings.image_file import MOST_PIXELS, ImageFile, decode, images_in, images_of, used_bits
from pps_vision.recordings.recording import usual_step_s
from pps_vision.recordings.times import Times
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Image

_SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".ts", ".mts", ".m2ts", ".3gp", ".wmv"),
    *(".h264", ".264", ".h265", ".265", ".hevc"),  # a bare stream, without stamps
)
# No playlists, whose files could be any on this machine or beyond.
_FORMATS = "mov,mp4,matroska,webm,avi,mpeg,mpegvideo,mpegts,asf,h264,hevc"
_CONTAINERS = {"format_whitelist": _FORMATS, "protocol_whitelist": "file"}
_FAR = 100  # frames ahead: seeking is faster than decoding what lies between
_BOTTOM_FIRST = (3, 4)  # of FFmpeg's AVFieldOrder: the bottom field is shown first


class _Decoder(local):
    """How far a thread has decoded a video."""

    def __init__(self, index: int) -> None:
        self.frames: Iterator[tuple[int, Decoded]] = iter(())
        self.to_rgb = VideoReformatter()  # its set-up and threads cost as much as a small image
        self.index = index  # index of the frame that was decoded last
        self.last: Decoded | Image | str = ""  # this frame, its pixels once they are needed, or why there are none


class Video:
    """A video file and how far each thread has decoded it: the next frame costs one frame, one far ahead or before a
    seek.

    Attributes:
        path: The file.
        image_size: Width and height of its images, turned as `turns` says.
        turns: Quarter turns anticlockwise by which its header says that images are to be shown.
        pixel_aspect: Width of a pixel relative to its height, in these images.
        fields: 2 where frames are interlaced: every second row is of another moment; else 1.
        pts: The frames' stamps in order, in units of `time_base_s`; without `has_stamps` they are counted instead.
        time_base_s: Seconds per unit of `pts`.
        stated_s: Its duration by the header, where this is known to be that of the images; else 0.
    """

    def __init__(self, path: Path, rotate: bool = True) -> None:
        check_regular(path, "a video")
        self.path = path
        self.turns = 0
        self.fields = 1
        self._bottom_first = False
        try:
            with self._open() as container:
                if not container.streams.video:
                    raise ValueError("it holds no images")
                stream = container.streams.video[0]
                if stream.codec_context is None:
                    raise ValueError("no decoder for it")
                pts = [packet.pts for packet in container.demux(stream) if packet.size and not packet.is_discard]
                self.image_size = stream.codec_context.width, stream.codec_context.height
                self.time_base_s = float(stream.time_base or 0)
                self.pixel_aspect = float(stream.sample_aspect_ratio or 1)
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
        self._read_first_frame(rotate)
        self._decoder = _Decoder(len(self.pts))

    def _open(self) -> InputContainer:
        return av.open(str(self.path), options=_CONTAINERS)

    def _read_first_frame(self, rotate: bool) -> None:
        """Read from the decoder how images are to be turned, and whether they are interlaced."""
        with suppress(av.error.FFmpegError, MemoryError), self._open() as container:
            stream = container.streams.video[0]
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            frame = next(container.decode(stream), None)
            if frame is None:
                return
            self.fields = 2 if frame.interlaced_frame else 1
            self._bottom_first = stream.codec_context.field_order in _BOTTOM_FIRST
            self.turns = round(frame.rotation / 90) % 4 if rotate else 0
        if self.turns % 2:
            self.image_size = self.image_size[1], self.image_size[0]
            self.pixel_aspect = 1 / self.pixel_aspect

    def image(self, index: int, field: int | None = None) -> Image | str:
        """Return a frame, or one of its fields (0: the first), as it is to be shown, or the reason why there is
        none."""
        image = self.load(index)
        if isinstance(image, str):
            return image
        if field is not None:
            image = _from_field(image, int(field == 0) if self._bottom_first else field)
        return image if self.turns == 0 else np.ascontiguousarray(np.rot90(image, self.turns))

    def load(self, index: int) -> Image | str:
        """Return a recorded frame, RGB uint8, not turned, or the reason why there is none."""
        here = self._decoder
        try:
            if index < here.index or (self.has_stamps and index > here.index + _FAR):
                here.index, here.frames = -1, self._decoded(index)
            while here.index < index:
                here.index, here.last = next(here.frames)
            if here.index == index and isinstance(here.last, Decoded):
                here.last = self._pixels(here.last, here.to_rgb)
            if here.index == len(self.pts) - 1:  # a recording may have many files
                here.frames = iter(())
        except StopIteration:  # as for all that come after it
            here.index, here.last = index, "is missing"
        except (av.error.FFmpegError, OSError, ValueError, MemoryError) as error:
            here.index, here.last = index, f"cannot be decoded ({first_line(error)})"
        return "is missing" if here.index != index or isinstance(here.last, Decoded) else here.last

    def _pixels(self, frame: Decoded, to_rgb: VideoReformatter) -> Image | str:
        size = self.image_size if self.turns % 2 == 0 else self.image_size[::-1]
        if (frame.width, frame.height) != size:
            return f"is {frame.width}×{frame.height} pixels"
        return np.asarray(to_rgb.reformat(frame, format="rgb24", threads=1).to_ndarray(), np.uint8)

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


def _from_field(image: Image, first_row: int) -> Image:
    """The image of one field: its rows stay in place, the other field's are the means of their neighbours."""
    whole = image.copy()
    rows = image[first_row::2].astype(np.uint16)
    between = ((rows[:-1] + rows[1:] + 1) // 2).astype(np.uint8)
    whole[first_row + 1 : first_row + 2 * len(between) : 2] = between
    if first_row:
        whole[0] = image[1]
    if (last := first_row + 2 * len(rows) - 1) < len(image):
        whole[last] = image[last - 1]
    return whole


@dataclass(frozen=True, slots=True)
class VideoFrame(ImageFile):
    """One frame of a video, or one field of an interlaced one."""

    video: Video = field(repr=False, compare=False, kw_only=True)
    first: int = field(default=0, kw_only=True)  # number of the file's first frame, where others come before
    fields: int = field(default=1, kw_only=True)  # 2: `index` counts fields

    @property
    def number(self) -> int:
        """Its place, from 0."""
        return self.first + self.index

    @property
    def title(self) -> str:
        """What reports call it."""
        return f"{'frame' if self.fields == 1 else 'field'} {self.index}"

    def load(self) -> Image | str:
        """The image as RGB uint8, or the reason why there is none."""
        frame, number = divmod(self.index, self.fields)
        return self.video.image(frame, None if self.fields == 1 else number)


def is_video(path: Path) -> bool:
    """Whether a file is called as videos are."""
    return path.suffix.lower() in _SUFFIXES and not path.is_dir()


def open_video(
    files: Path | Sequence[Path],
    fps: float | None,
    times: Times | None = None,
    rotate: bool = True,
    by_field: bool = False,
) -> list[VideoFrame]:
    """All frames of a video, with the stamps of `times`, of a constant rate `fps`, or else the file's own.

    Several files continue each other.  With `by_field` both fields of each interlaced frame, the second half an
    interval later.  InputError if there is no video, or it has no stamps and none are given.
    """
    frames: list[VideoFrame] = []
    for file in (files,) if isinstance(files, Path) else files:
        video = Video(file, rotate)
        if times and times.names:
            raise InputError(times.file, f"names images; expected a stamp for each frame of {file.name}, without names")
        if not (fps or times or video.has_stamps):
            raise InputError(file, "not every frame has a stamp of its own; expected --fps or --times with this file")
        step_s = 1 / fps if fps else video.time_base_s
        stamps_s = [step * step_s for step in (range(len(video.pts)) if fps else video.pts)]
        if frames:
            start_s = frames[-1].stamp_s + usual_step_s([frame.stamp_s for frame in frames]) - stamps_s[0]
            stamps_s = [start_s + stamp_s for stamp_s in stamps_s]
        first = len(frames)
        frames += [VideoFrame(file, t, index=k, video=video, first=first) for k, t in enumerate(stamps_s)]
    if times:
        has_rate = frames[0].video.has_stamps and not fps
        frames = times.stamp(frames, [], usual_step_s([frame.stamp_s for frame in frames]) if has_rate else 0.0)
    if not (by_field and frames[0].video.fields == 2):
        return frames
    half_s = 0.5 * usual_step_s([frame.stamp_s for frame in frames])
    return [
        replace(frame, stamp_s=frame.stamp_s + k * half_s, index=2 * frame.index + k, first=2 * frame.first, fields=2)
        for frame in frames
        for k in (0, 1)
    ]


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
        bits = used_bits(self.files)
        for frame, file in enumerate(self.files, start=1):
            image = decode(file, self.image_size, bits)
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
        files = tuple(images_of(images_in(folder)))
    else:
        reason = "is no folder and no video" if folder.exists() else "no such folder"
        raise InputError(folder, f"{reason}; expected a folder with the frames of a sequence, or a video")
    first = next((image for image in map(decode, files) if not isinstance(image, Problem)), None)
    if first is None:
        raise InputError(folder, f"no usable frame among {len(files)} images; expected files such as 0001.png")
    return ImageSequence(files, (first.shape[1], first.shape[0]), [])
