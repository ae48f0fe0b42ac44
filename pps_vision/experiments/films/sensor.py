"""Sensor of the ray-cast films: from light to the recorded image. Shares no code with `rendering.sensor`."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Image

_TAPE_LENGTH = 1 << 21


@dataclass(frozen=True)
class SensorChain:
    """Stages in this order: defocus, gain, mosaic, noise, eight bits, grey, JPEG."""

    defocus_px: float = 0.0
    """Standard deviation of the defocus blur."""
    read_noise: float = 2.0  # standard deviation of the noise that does not depend on the light, levels
    shot: float = 0.0  # variance of the shot noise per level
    bayer: bool = False  # one colour a pixel (RGGB), the others interpolated by OpenCV
    grey: bool = False  # A grey camera: three equal channels
    jpeg: int = 0  # JPEG quality, 1–100; 0: not compressed

    def expose(self, light: NDArray[np.float32], gain: float, rng: np.random.Generator, tape: Array) -> Image:
        """Return the image (h, w, 3) of light; the noise of each row is cut from the tape where `rng` says."""
        if self.defocus_px > 0:
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), self.defocus_px), dtype=np.float32)
        if self.bayer:
            light = _mosaic(light)
        h, w = light.shape[:2]
        rows = light.reshape(h, -1)
        image: Image = np.empty(rows.shape, np.uint8)
        starts = rng.integers(0, len(tape) - rows.shape[1], h)
        _add_noise(rows, gain, self.read_noise**2, self.shot, tape, starts, image)
        if self.bayer:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BayerRGGB2RGB), dtype=np.uint8)
        image = image.reshape(h, w, 3)
        if self.grey:
            image = np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB), np.uint8)
        if self.jpeg:
            coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
        return image


def noise_tape(rng: np.random.Generator) -> Array:
    """Return normal deviates (n,) for `SensorChain.expose`."""
    return rng.standard_normal(_TAPE_LENGTH, dtype=np.float32)


def _mosaic(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) of an RGGB sensor."""
    mosaic = light[..., 1].copy()
    mosaic[::2, ::2] = light[::2, ::2, 0]
    mosaic[1::2, 1::2] = light[1::2, 1::2, 2]
    return mosaic


@njit(cache=True, error_model="numpy")
def _add_noise(light, gain, read_var, shot, tape, starts, image):  # type: ignore[no-untyped-def]
    for y in range(light.shape[0]):
        start = starts[y]
        for x in range(light.shape[1]):
            level = gain * light[y, x]
            level += tape[start + x] * np.sqrt(read_var + shot * level)
            image[y, x] = np.uint8(min(max(level + 0.5, 0.0), 255.0))
