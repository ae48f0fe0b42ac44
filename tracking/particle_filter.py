"""A particle filter over an object's place and scale in one image (R, "3D particle filter")."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array

# Of the motion model x ← 2x₁ − x₂ + noise, a second-order autoregression; `bench imagetracker` shows what they reach.
_STD_POSITION = 0.25  # of the object's size: standard deviation of the position's noise
_LEAST_STD_POSITION = 0.05  # of the object's size, where the position is predicted
_STD_SCALE = 0.04  # relative standard deviation of the scale's noise
SHARPNESS = 12.0
"""Factor of the log-likelihood."""


class Prior(NamedTuple):  # constructing a frozen dataclass is three times slower
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
    count: int,
    center_px: Array,
    size_px: float,
    spread_px: float,
    rng: np.random.Generator,
    shift_px: Array | None = None,
) -> Cloud:
    """So many particles around a place, which move by `shift_px` (2,) a frame (None: at rest); `spread_px` is their
    standard deviation."""
    now = np.ones((count, 3))
    now[:, :2] = center_px + spread_px * rng.standard_normal((count, 2))
    now[:, 2] = size_px
    before = now.copy()
    if shift_px is not None:
        before[:, :2] -= shift_px
    return Cloud(now, before)


def propagate(cloud: Cloud, prior: Prior | None, rng: np.random.Generator) -> Cloud:
    """One frame on.  Where the place is known from elsewhere (the 3D track, with the head's motion in
    it), the cloud is carried there; otherwise it goes on as it went."""
    now, middle = cloud.now.copy(), cloud.now[:, :2].mean(axis=0)
    if prior is None:
        now[:, :2] += middle - cloud.before[:, :2].mean(axis=0)
        std = _STD_POSITION * now[:, 2:]
    else:
        now[:, :2] += prior.center_px - middle
        now[:, 2] *= prior.growth
        std = np.maximum(_LEAST_STD_POSITION * now[:, 2:], prior.std_px)
    now[:, :2] += std * rng.standard_normal((len(now), 2))
    now[:, 2] *= np.exp(_STD_SCALE * rng.standard_normal(len(now)))
    return Cloud(now, cloud.now)


def weigh(
    cloud: Cloud,
    integral: NDArray[np.float64],
    corner: tuple[int, int],
    shape: tuple[float, float],
) -> Array:
    """(n,) normalised weights from the integral image of 2p − 1 (p the object probability).

    A box gains by every object pixel it takes in and loses by every other, relative to its expected
    area; `corner` is the integral's place in the image, `shape` the box's sides per unit scale.
    """
    gain = box_sums(integral, cloud.now, corner, (0.5 * shape[0], 0.5 * shape[1]))
    area = shape[0] * shape[1] * float(np.mean(cloud.now[:, 2])) ** 2
    log = SHARPNESS * gain / max(area, 1.0)
    weights: Array = np.exp(log - log.max())
    return weights / weights.sum()


def box_sums(
    integral: NDArray[np.float64], cloud: Array, corner: tuple[int, int], half_sides: tuple[float, float]
) -> Array:
    """(n,) sums over the box of each particle (x, y, scale), from the integral image (h + 1, w + 1) of the region that
    begins at `corner`; `half_sides` are the box's at scale 1."""
    reach = cloud[:, 2:] * np.array(half_sides)
    most = np.array(integral.shape)[::-1] - 1
    middle = cloud[:, :2] - np.array(corner) + 0.5
    (x0, y0), (x1, y1) = (np.clip(np.rint(end), 0, most).astype(np.intp).T for end in (middle - reach, middle + reach))
    sums: Array = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
    return sums


def resample(cloud: Cloud, weights: Array, rng: np.random.Generator) -> Cloud:
    """Systematic resampling."""
    n = len(weights)
    ladder = (rng.random() + np.arange(n)) / n
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), ladder), n - 1)
    return Cloud(cloud.now[chosen], cloud.before[chosen])
