"""Sensor model: exposure, shot and read noise, quantisation to eight bits."""

from dataclasses import dataclass

import numpy as np

from pps_vision.errors import InputError
from pps_vision.types import Array, Image

_LARGEST = 255.0  # grey levels; no parameter is meaningful above full scale


@dataclass(frozen=True)
class Sensor:
    """Everything off by default.  Levels are grey levels of 255, proportional to light.

    `noise_sigma` is the standard deviation of Gaussian read noise; `shot` the variance of shot
    noise per grey level of signal; `exposure` the gain, saturating at 255; `blur_s` how long
    the shutter is open, centred on the stamp.
    """

    noise_sigma: float = 0.0
    shot: float = 0.0
    exposure: float = 1.0
    blur_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("noise_sigma", "shot", "exposure", "blur_s"):
            value = getattr(self, name)
            if not 0 <= value <= _LARGEST:
                raise InputError("sensor", f"{name} = {value}; expected a number from 0 to {_LARGEST:.0f}")


def expose(sensor: Sensor, light: Array, rng: np.random.Generator | None) -> Image:
    """Return the recorded image (h, w, 3) of the light (h, w, 3) float32 on the sensor.

    Noise is independent per pixel and channel; `rng` may be None only for a noiseless sensor.
    """
    signal = light * np.float32(sensor.exposure)
    if sensor.noise_sigma > 0 or sensor.shot > 0:
        if rng is None:
            raise ValueError("a noisy sensor asks for a random generator, got None")
        noise = rng.standard_normal(signal.shape, dtype=np.float32)
        signal += noise * np.sqrt(np.float32(sensor.noise_sigma**2) + np.float32(sensor.shot) * signal)
    return np.rint(np.clip(signal, 0, 255)).astype(np.uint8)
