"""Small videos, written with PyAV."""

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

BITS = 10


def encode(
    file: Path,
    images: Iterable[np.ndarray],
    fps: float = 25.0,
    stamps_s: Sequence[float] | None = None,
    codec: str = "libx264",
    pix_fmt: str = "yuv420p",
    set_up: Callable[[av.VideoStream], None] = lambda _: None,
    **options: str,
) -> Path:
    """A video of RGB images at a rate, or with these stamps, to a millisecond; `options` are the encoder's, and
    `set_up` changes the stream before it is written."""
    with av.open(str(file), "w") as container:
        rate = 1000 if stamps_s else Fraction(fps).limit_denominator(1001)
        stream = container.add_stream(codec, rate=rate, options=options)
        stream.pix_fmt = pix_fmt
        if stamps_s:
            stream.codec_context.time_base = Fraction(1, 1000)
        set_up(stream)
        for k, image in enumerate(images):
            if k == 0:
                stream.height, stream.width = image.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            if stamps_s:
                frame.pts = round(1000 * stamps_s[k])
                frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file


def coded(k: int, size: tuple[int, int] = (160, 120)) -> np.ndarray:
    """Frame k: its bits as dark and brighter bands, the right half brighter by 100."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    for bit, rows in enumerate(np.array_split(np.arange(size[1]), BITS)):
        image[rows] = 90 if k >> bit & 1 else 20
    image[:, size[0] // 2 :] += 100
    return image


def number_of(image: np.ndarray | str) -> int | str:
    """Which frame an image is, by its left half, or the reason why it cannot be read."""
    if isinstance(image, str):
        return image
    bands = np.array_split(image[:, : image.shape[1] // 2 - 8].mean(axis=(1, 2)), BITS)
    return sum((float(np.median(band)) > 55) << bit for bit, band in enumerate(bands))


def write_video(
    file: Path, stamps_s: Sequence[float], codec: str = "mpeg4", size: tuple[int, int] = (160, 120), **options: str
) -> Path:
    """A video of `coded` frames with these stamps."""
    images = (coded(k, size) for k in range(len(stamps_s)))
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    return encode(file, images, stamps_s=stamps_s, codec=codec, pix_fmt=pix_fmt, g="12", **options)
