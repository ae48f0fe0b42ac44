"""Small videos with known stamps, written with PyAV."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

BITS = 10


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
    """A video of `coded` frames with these stamps, to a millisecond."""
    with av.open(str(file), "w") as container:
        stream = container.add_stream(codec, rate=1000, options={"g": "12", **options})
        stream.width, stream.height, stream.pix_fmt = *size, "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for k, stamp_s in enumerate(stamps_s):
            frame = av.VideoFrame.from_ndarray(coded(k, size), format="rgb24")
            frame.pts = round(1000 * stamp_s)
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file
