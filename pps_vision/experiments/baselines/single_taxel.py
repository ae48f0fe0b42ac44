"""R's Monte Carlo of a single taxel: simulated objects approach virtual taxels (R, Figs 2 and 3)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.types import Array, Mask

NORMAL = np.array([0.0, 0.0, 1.0])  # normal of a taxel in its own frame
UNBOUNDED = ReceptiveField(base_radius_m=10.0, length_m=10.0)
"""A field that holds every sample: R's published maps use no cone."""


@dataclass(frozen=True)
class Simulation:
    """Objects on straight paths at constant speed, from a starting zone above a flat skin to a Gaussian landing point.

    The landing points are about the first taxel. Values are R's; where its text is silent, values of its released data.
    """

    start_distance_m: tuple[float, float] = (0.25, 0.30)  # range of the start's distance, uniform (released data)
    start_half_angle_rad: float = float(np.pi / 4)
    """Greatest angle of the start from the normal, uniform (released data)."""
    landing_sigma_m: float = 0.05  # standard deviation of the landing point, each axis
    speed_m_s: tuple[float, float] = (0.05, 0.15)  # range of the speed, uniform
    taxels_m: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0173, 0.0), (-0.0087, 0.015))
    """Positions on the skin; the default are neighbouring triangular modules of the iCub's skin."""
    touch_radius_m: float = 0.02  # greatest distance from a taxel at which a landing point touches it
    position_noise_m: float = 0.0  # standard deviation of the measured position, each axis
    velocity_noise_m_s: float = 0.0  # standard deviation of the measured velocity, each axis
    offset_m: float = 0.0  # systematic error of the measured position along the normal
    step_s: float = 0.05  # sampling period
    length_s: float = 3.0  # time before the landing that is kept (R's buffer)


@dataclass(frozen=True)
class Paths:
    """Measured paths of N objects up to their landing, oldest sample first."""

    d_m: Array  # (N, T, n, 3) displacements from the n taxels, NaN before the start
    v_m_s: Array  # (N, T, 1, 3) velocities
    touched: Mask  # (N, n) touched taxels


def sample_paths(simulation: Simulation, n: int, rng: np.random.Generator) -> Paths:
    """Return the paths of n objects."""
    s = simulation
    landing = np.zeros((n, 3))
    landing[:, :2] = rng.normal(0.0, s.landing_sigma_m, (n, 2))
    distance = rng.uniform(*s.start_distance_m, n)
    angle = rng.uniform(0, s.start_half_angle_rad, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    direction = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    path = landing - distance[:, None] * direction
    speed = rng.uniform(*s.speed_m_s, n)
    length = np.linalg.norm(path, axis=1)
    velocity = path * (speed / length)[:, None]
    duration = length / speed
    steps = np.arange(int(s.length_s / s.step_s), -1, -1)
    remaining = np.mod(duration, s.step_s)[:, None] + steps * s.step_s  # (N, T) s until the landing
    remaining[remaining > duration[:, None] + 1e-9] = np.nan
    p = landing[:, None] - remaining[..., None] * velocity[:, None] + s.offset_m * NORMAL
    v = np.broadcast_to(velocity[:, None], p.shape)
    if s.position_noise_m or s.velocity_noise_m_s:
        p += rng.normal(0, s.position_noise_m, p.shape)
        v = v + rng.normal(0, s.velocity_noise_m_s, p.shape)
    taxels = np.array([(x, y, 0.0) for x, y in s.taxels_m])
    touched = np.linalg.norm(landing[:, None] - taxels, axis=2) <= s.touch_radius_m
    return Paths(p[:, :, None] - taxels, v[:, :, None], touched)


def from_taxel(
    d_m: ArrayLike, v_m_s: ArrayLike, field: ReceptiveField, radius_m: float = 0.0, cov_v: Array | None = None
) -> tuple[Array, Array]:
    """Return D and TTC (…, T, n), measured from the taxel (R eqs 1–2)."""
    D, ttc = perceive(field, np.zeros((1, 3)), NORMAL, d_m, v_m_s, radius_m, cov_v)
    return D[..., 0], ttc[..., 0]


def from_landing(d_m: ArrayLike, v_m_s: ArrayLike, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Return D and TTC (…, T − 1, n), measured from the last displacement, which is not a sample (R's published maps).

    With an offset, TTC is the time to the path's end and D is measured from the touched point of the assumed skin: the
    ridge crosses TTC = 0 at the offset. The counts behind R Fig 3 shift D and TTC together, so that their ridge crosses
    near 0 (study `pps_taxel`, part `authors_counts`).
    """
    d = np.asarray(d_m, dtype=float)
    v = np.asarray(v_m_s, dtype=float)[..., :-1, :, :]
    from_end = d[..., :-1, :, :] - d[..., -1:, :, :]
    _, ttc = from_taxel(from_end, v, UNBOUNDED)
    distance, _ = from_taxel(from_end + offset_m * NORMAL, v, UNBOUNDED)
    return distance, ttc


def empty_map(n: int, params: MemoryParams) -> PPSMemory:
    """Return a map of n taxels of one body part without samples."""
    return PPSMemory(tuple(map(str, range(n))), np.zeros(n, np.intp), np.zeros((n, *params.bins, 2), np.int64), params)


def count_paths(memory: PPSMemory, D: Array, TTC: Array, touched: Mask) -> PPSMemory:
    """Return the map after counting samples D and TTC (N, T, n) of N objects.

    Objects without a touch are not counted (R, "Data collection"). Objects that touch the same taxels are counted
    together.
    """
    n = touched.shape[1]
    for pattern in np.unique(touched[touched.any(axis=1)], axis=0):
        matches = np.all(touched == pattern, axis=1)
        memory = count_samples(memory, D[matches].reshape(-1, n), TTC[matches].reshape(-1, n), pattern)
    return memory
