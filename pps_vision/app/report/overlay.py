"""Overlay of the track on the eyes' images, and video files."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import PIL.Image
from numpy.typing import ArrayLike

from pps_vision.app.report.colors import track_rgb
from pps_vision.geometry.camera import StereoView
from pps_vision.types import Array, Image, Status, StereoFrame
from tracking.tracker import TrackerStep

_STATUS_RGB = {
    Status.SEARCHING: (200, 200, 200),
    Status.TRACKING: (60, 230, 90),
    Status.COASTING: (250, 190, 40),
    Status.LOST: (250, 70, 60),
}
_SMALL = 960  # width (px) of images that are shown twice as large
_SHIFT = 4  # cv2 draws at 1/16 px


class VideoFile(AbstractContextManager["VideoFile"]):
    """An .mp4 (H.264, which every browser plays), written as images come; no image, no file."""

    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._rate = Fraction(fps).limit_denominator(1000)
        self._file: av.container.OutputContainer | None = None
        self._stream: av.VideoStream | None = None

    def add(self, image: Image) -> None:
        """Append an RGB image; all have the first one's size, cut to even numbers."""
        image = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
        if self._file is None or self._stream is None:
            self._file = av.open(str(self._path), "w")
            self._stream = self._file.add_stream("libx264", self._rate, options={"crf": "22", "preset": "veryfast"})
            self._stream.height, self._stream.width = image.shape[:2]
            self._stream.pix_fmt = "yuv420p"
        self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))

    def __exit__(self, kind: object, *error: object) -> None:
        if self._file is not None and self._stream is not None:
            if kind is None:
                self._file.mux(self._stream.encode())
            self._file.close()


def save_jpeg(file: Path, image: Image) -> None:
    """Write an RGB image."""
    file.write_bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes())


def save_png(file: Path, image: Image) -> None:
    """Write an RGB image with a palette of 256 colours."""
    PIL.Image.fromarray(image).quantize(256, PIL.Image.Quantize.MAXCOVERAGE).save(file, "PNG", optimize=True)


def draw_pair(
    frame: StereoFrame,
    view: StereoView,
    step: TrackerStep,
    taxels_root: Array | None = None,
    activations: Array | None = None,
    captions: Sequence[str] = (),
) -> Image:
    """Both eyes side by side, small images enlarged: detections (rings, the attended object's thick) and tracks
    (crosses) in the colours of their numbers, taxels by activation."""
    scale = 2 if frame.left.shape[1] <= _SMALL else 1
    objects = step, *(other for other in step.others if other.track.is_known)
    sides: list[Image] = []
    for name, image, eye in (("left", frame.left, view.left), ("right", frame.right, view.right)):
        size = (image.shape[1] * scale, image.shape[0] * scale)
        canvas: Image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8, copy=False)
        if taxels_root is not None and activations is not None:
            for pixel, a in zip(eye.project(taxels_root), activations, strict=True):
                if eye.camera.contains(pixel):  # the larger and the redder, the likelier a touch
                    radius = round(scale * (1.2 + 3 * float(np.clip(a, 0, 1))) * 2**_SHIFT)
                    cv2.circle(canvas, _at(pixel, scale), radius, _taxel_rgb(float(a)), -1, cv2.LINE_AA, _SHIFT)
        for item in objects:
            color = track_rgb(item.track.track_id)
            for detection in item.detections:
                if detection.camera == name and np.all(np.isfinite(detection.center_px)):
                    radius = round(eye.camera.focal_px * np.tan(detection.angular_radius_rad) * scale * 2**_SHIFT)
                    if 0 < radius < 2**20:
                        ring = _at(detection.center_px, scale), radius, color, 2 if item is step else 1
                        cv2.circle(canvas, *ring, cv2.LINE_AA, _SHIFT)
            if item.track.is_known and np.all(np.abs(pixel := eye.project(item.track.position)) < 2**20):
                u, v = _at(pixel, scale)
                arm = round(3.5 * scale * 2**_SHIFT)
                for du, dv in ((arm, 0), (0, arm)):  # a cross
                    cv2.line(canvas, (u - du, v - dv), (u + du, v + dv), color, 1, cv2.LINE_AA, _SHIFT)
        sides.append(canvas)
    height = max(len(side) for side in sides)
    pair = np.concatenate([np.pad(side, ((0, height - len(side)), (0, 0), (0, 0))) for side in sides], axis=1)
    status = step.track.status
    _write(pair, f"{status.value}   {frame.stamp_s:7.2f} s", (8, 20), _STATUS_RGB[status])
    for line, caption in enumerate(captions, start=1):
        _write(pair, caption, (8, 20 + 18 * line), (255, 255, 255))
    return pair


def _at(pixel: ArrayLike, scale: int) -> tuple[int, int]:
    """Sub-pixel canvas coordinates of an image pixel, for cv2's shifted drawing."""
    u, v = (np.asarray(pixel, dtype=float) + 0.5) * scale - 0.5
    return round(u * 2**_SHIFT), round(v * 2**_SHIFT)


def _taxel_rgb(activation: float) -> tuple[int, int, int]:
    """Grey at rest, from yellow to red as a touch becomes likely."""
    hot = min(max(activation, 0.0), 1.0)
    return (255, int(255 * (1 - hot)), 0) if hot > 0.02 else (150, 150, 170)


def draw_legend(canvas: Image) -> None:
    """Draw the colour scale of taxels at the lower edge of an image."""
    height = canvas.shape[0] - 8
    left = 160
    for k in range(100):
        at = (left + 2 * k, height - 24), (left + 2 * k + 1, height - 12)
        cv2.rectangle(canvas, *at, _taxel_rgb(k / 99), -1)
    _write(canvas, "skin: touch likely 0", (8, height - 6), (255, 255, 255))
    _write(canvas, "1", (left + 206, height - 6), (255, 255, 255))


def flash(canvas: Image) -> None:
    """Draw a red frame and TOUCH over an image."""
    height, width = canvas.shape[:2]
    cv2.rectangle(canvas, (0, 0), (width - 1, height - 1), (250, 40, 40), 12)
    cv2.putText(canvas, "TOUCH", (24, height - 60), cv2.FONT_HERSHEY_DUPLEX, 1.8, (0, 0, 0), 8, cv2.LINE_AA)
    cv2.putText(canvas, "TOUCH", (24, height - 60), cv2.FONT_HERSHEY_DUPLEX, 1.8, (250, 40, 40), 3, cv2.LINE_AA)


def _write(canvas: Image, text: str, where: tuple[int, int], color: tuple[int, int, int]) -> None:
    cv2.putText(canvas, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(canvas, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
