"""A particle filter over an object's place and scale in one image (R, "3D particle filter"; FACTS §4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array


@dataclass(frozen=True)
class ParticleParams:
    """`count` particles; `std_position` (of the object's size) and `std_scale` (relative) drive the
    second-order autoregression x ← 2x₁ − x₂ + noise; `sharpness` scales the log-likelihood."""

    count: int = 120
    std_position: float = 0.25
    std_scale: float = 0.04
    sharpness: float = 12.0

    def __post_init__(self) -> None:
        if self.count < 2 or not (self.std_position > 0 and self.std_scale > 0 and self.sharpness > 0):
            raise ValueError(f"{self}: expected at least 2 particles and positive spreads")


@dataclass(frozen=True, slots=True)
class Prior:
    """Where the object should be: centre (2,) px, standard deviation px, and its image's size relative
    to the last one."""

    center_px: Array
    std_px: float
    growth: float


@dataclass(frozen=True, slots=True)
class Cloud:
    """`now` and `before` (n, 3): x, y of the centre in px and the scale of the box, a frame apart."""

    now: Array
    before: Array


def spawn(
    params: ParticleParams, center_px: Array, size_px: float, spread_px: float, rng: np.random.Generator
) -> Cloud:
    """Particles at rest around a place; `spread_px` their standard deviation."""
    now = np.ones((params.count, 3))
    now[:, :2] = center_px + spread_px * rng.standard_normal((params.count, 2))
    now[:, 2] = size_px
    return Cloud(now, now.copy())


def propagate(params: ParticleParams, cloud: Cloud, prior: Prior | None, rng: np.random.Generator) -> Cloud:
    """One frame on.  Where the place is known from elsewhere (the 3D track, with the head's motion in
    it), the cloud is carried there; otherwise it goes on as it went."""
    now = cloud.now.copy()
    if prior is None:
        now[:, :2] += (cloud.now[:, :2] - cloud.before[:, :2]).mean(axis=0)
    else:
        now[:, :2] += prior.center_px - now[:, :2].mean(axis=0)
        now[:, 2] *= prior.growth
    std = params.std_position * now[:, 2:] if prior is None else np.maximum(0.05 * now[:, 2:], prior.std_px)
    now[:, :2] += std * rng.standard_normal((len(now), 2))
    now[:, 2] *= np.exp(params.std_scale * rng.standard_normal(len(now)))
    return Cloud(now, cloud.now)


def weigh(
    params: ParticleParams,
    cloud: Cloud,
    integral: NDArray[np.float64],
    corner: tuple[int, int],
    shape: tuple[float, float],
) -> Array:
    """(n,) normalised weights from the integral image of 2p − 1 (p the object probability).

    A box gains by every object pixel it takes in and loses by every other, relative to its expected
    area; `corner` is the integral's place in the image, `shape` the box's sides per unit scale.
    """
    h, w = integral.shape[0] - 1, integral.shape[1] - 1
    half = 0.5 * cloud.now[:, 2:] * np.array(shape)
    low = np.rint(cloud.now[:, :2] - half - corner + 0.5).astype(int)
    high = np.rint(cloud.now[:, :2] + half - corner + 0.5).astype(int)
    x0, x1 = np.clip(low[:, 0], 0, w), np.clip(high[:, 0], 0, w)
    y0, y1 = np.clip(low[:, 1], 0, h), np.clip(high[:, 1], 0, h)
    gain = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
    area = shape[0] * shape[1] * float(np.mean(cloud.now[:, 2])) ** 2
    log = params.sharpness * gain / max(area, 1.0)
    weights: Array = np.exp(log - log.max())
    return weights / weights.sum()


def resample(cloud: Cloud, weights: Array, rng: np.random.Generator) -> Cloud:
    """Systematic resampling."""
    n = len(weights)
    ladder = (rng.random() + np.arange(n)) / n
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), ladder), n - 1)
    return Cloud(cloud.now[chosen], cloud.before[chosen])
