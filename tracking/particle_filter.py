"""Particle filter over the position and scale of an object in one image (R, "3D particle filter")."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array

# Noise of the second-order autoregression x ← 2x₁ − x₂ + noise (`bench stages`, part `image_tracker`).
_STD_POSITION = 0.25  # in object sizes, without a prior
_MIN_STD_POSITION = 0.05  # in object sizes, with a prior
_STD_SCALE = 0.04  # relative
SHARPNESS = 12.0
"""Factor of the log-likelihood."""


class Prior(NamedTuple):  # constructing a frozen dataclass is three times slower
    """Predicted position: centre (2,) px, its standard deviation (px), and the size relative to the last image."""

    center_px: Array
    std_px: float
    growth: float


@dataclass(frozen=True, slots=True)
class Particles:
    """Particles (n, 3) in the current and the previous image: centre x, y (px) and scale of the box."""

    current: Array
    previous: Array


def sample(
    count: int,
    center_px: Array,
    size_px: float,
    spread_px: float,
    rng: np.random.Generator,
    shift_px: Array | None = None,
) -> Particles:
    """Particles around a position.

    Args:
        count: Number of particles.
        center_px: Their mean (2,).
        size_px: Their scale.
        spread_px: Standard deviation of their positions.
        rng: Source of the noise.
        shift_px: Motion (2,) from the previous to the current image; None: at rest.
    """
    current = np.ones((count, 3))
    current[:, :2] = center_px + spread_px * rng.standard_normal((count, 2))
    current[:, 2] = size_px
    previous = current.copy()
    if shift_px is not None:
        previous[:, :2] -= shift_px
    return Particles(current, previous)


def propagate(particles: Particles, prior: Prior | None, rng: np.random.Generator) -> Particles:
    """The particles in the next image: moved to the prior, or without a prior by their last motion."""
    moved = particles.current.copy()
    mean = moved[:, :2].mean(axis=0)
    if prior is None:
        moved[:, :2] += mean - particles.previous[:, :2].mean(axis=0)
        std_px = _STD_POSITION * moved[:, 2:]
    else:
        moved[:, :2] += prior.center_px - mean
        moved[:, 2] *= prior.growth
        std_px = np.maximum(_MIN_STD_POSITION * moved[:, 2:], prior.std_px)
    moved[:, :2] += std_px * rng.standard_normal((len(moved), 2))
    moved[:, 2] *= np.exp(_STD_SCALE * rng.standard_normal(len(moved)))
    return Particles(moved, particles.current)


def likelihoods(
    particles: Particles,
    integral: NDArray[np.float64],
    corner: tuple[int, int],
    shape: tuple[float, float],
) -> Array:
    """Normalised likelihoods (n,) of the particles.

    A box gains by every object pixel inside it and loses by every other, relative to its expected area.

    Args:
        particles: The particles (n).
        integral: Integral image of 2p − 1, p the probability that a pixel belongs to the object.
        corner: Position of the integral image's first pixel in the image.
        shape: Width and height of the box at scale 1.
    """
    gain = box_sums(integral, particles.current, corner, (0.5 * shape[0], 0.5 * shape[1]))
    area = shape[0] * shape[1] * float(np.mean(particles.current[:, 2])) ** 2
    log = SHARPNESS * gain / max(area, 1.0)
    weights: Array = np.exp(log - log.max())
    return weights / weights.sum()


def box_sums(
    integral: NDArray[np.float64], particles: Array, corner: tuple[int, int], half_sides: tuple[float, float]
) -> Array:
    """Sums (n,) over the boxes of particles (n, 3), from the integral image (h + 1, w + 1) of the region that begins at
    `corner`; `half_sides` are those of a box at scale 1."""
    half = particles[:, 2:] * np.array(half_sides)
    limit = np.array(integral.shape)[::-1] - 1
    middle = particles[:, :2] - np.array(corner) + 0.5
    x0, y0 = np.clip(np.rint(middle - half), 0, limit).astype(np.intp).T
    x1, y1 = np.clip(np.rint(middle + half), 0, limit).astype(np.intp).T
    sums: Array = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
    return sums


def resample(particles: Particles, weights: Array, rng: np.random.Generator) -> Particles:
    """Draw particles in proportion to their weights (systematic resampling)."""
    n = len(weights)
    positions = (rng.random() + np.arange(n)) / n
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), positions), n - 1)
    return Particles(particles.current[chosen], particles.previous[chosen])
