"""R's Monte Carlo of a single taxel: simulated objects approach three virtual taxels (R, Figs 2 and 3)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.types import Array, Mask

Reference = Literal["taxel", "landing"]
"""Point from which D and TTC are measured: the taxel (R eqs 1–2), or the path's end (R's published maps)."""

_UP = np.array([0.0, 0.0, 1.0])
_NO_CONE = ReceptiveField(base_radius_m=10.0, length_m=10.0)  # the published maps know no cone
_CHUNK = 2000  # objects simulated at once, which bounds the memory in use


@dataclass(frozen=True)
class Simulation:
    """Objects on straight paths at constant speed, from a starting zone above a flat skin to a Gaussian landing point.

    The landing points are about the first taxel. Values are R's; where its text is silent, those of its released data.
    """

    start_distance_m: tuple[float, float] = (0.25, 0.30)
    """Range of the start's distance, uniform (released data)."""
    start_half_angle_rad: float = float(np.pi / 4)
    """Greatest angle of the start from the normal, uniform (released data)."""
    landing_sigma_m: float = 0.05
    """Standard deviation of the landing point, each axis."""
    speed_m_s: tuple[float, float] = (0.05, 0.15)
    """Range of the speed, uniform."""
    taxels_m: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0173, 0.0), (-0.0087, 0.015))
    """Positions on the skin; the default are neighbouring triangular modules of the iCub's skin."""
    touch_radius_m: float = 0.02
    """A landing point this near to a taxel touches it."""
    position_noise_m: float = 0.0
    """Standard deviation of the measured position, each axis."""
    velocity_noise_m_s: float = 0.0
    """Standard deviation of the measured velocity, each axis."""
    offset_m: float = 0.0
    """Systematic error of the measured position along the normal."""
    step_s: float = 0.05
    """Sampling period."""
    length_s: float = 3.0
    """Time before the landing that is kept (R's buffer)."""


@dataclass(frozen=True)
class Paths:
    """Measured paths of N objects up to their landing, oldest sample first: displacements from the n taxels `d_m`
    (N, T, n, 3) and velocities `v_m_s` (N, T, 1, 3), NaN before the start; the taxels `touched` (N, n)."""

    d_m: Array
    v_m_s: Array
    touched: Mask


def sample_paths(simulation: Simulation, n: int, rng: np.random.Generator) -> Paths:
    """Return the paths of n objects."""
    s = simulation
    landing = np.zeros((n, 3))
    landing[:, :2] = rng.normal(0.0, s.landing_sigma_m, (n, 2))
    distance = rng.uniform(*s.start_distance_m, n)
    angle, azimuth = rng.uniform(0, s.start_half_angle_rad, n), rng.uniform(0, 2 * np.pi, n)
    direction = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    path, speed = landing - distance[:, None] * direction, rng.uniform(*s.speed_m_s, n)
    length = np.linalg.norm(path, axis=1)
    velocity, duration = path * (speed / length)[:, None], length / speed
    steps = np.arange(int(s.length_s / s.step_s), -1, -1)
    remaining = np.mod(duration, s.step_s)[:, None] + steps * s.step_s  # (N, T) s until the landing
    remaining[remaining > duration[:, None] + 1e-9] = np.nan
    p = landing[:, None] - remaining[..., None] * velocity[:, None] + s.offset_m * _UP
    v = np.broadcast_to(velocity[:, None], p.shape)
    if s.position_noise_m or s.velocity_noise_m_s:
        p += rng.normal(0, s.position_noise_m, p.shape)
        v = v + rng.normal(0, s.velocity_noise_m_s, p.shape)
    taxels = np.array([(x, y, 0.0) for x, y in s.taxels_m])
    touched = np.linalg.norm(landing[:, None] - taxels, axis=2) <= s.touch_radius_m
    return Paths(p[:, :, None] - taxels, v[:, :, None], touched)


def from_taxel(paths: Paths) -> tuple[Array, Array]:
    """Return D and TTC (N, T, n) as the taxels perceive them (R eqs 1–2)."""
    return distance_and_ttc(ReceptiveField(), paths.d_m, _UP, paths.v_m_s)


def from_landing(d_m: Array, v_m_s: Array, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Return D and TTC (…, T − 1, n) of displacements and velocities (…, T, n, 3), measured from the last displacement,
    which is no sample itself: R's published maps.

    With an offset, TTC is the time to the path's end and D is measured from the point of the assumed skin that was
    touched: the ridge crosses TTC = 0 at the offset.  The counts behind R Fig 3 shift D and TTC alike, so that theirs
    crosses it near 0 (study `pps_authors_counts`).
    """
    d, v = np.asarray(d_m, dtype=float), np.asarray(v_m_s, dtype=float)
    left = d[..., :-1, :, :] - d[..., -1:, :, :]
    _, ttc = distance_and_ttc(_NO_CONE, left, _UP, v[..., :-1, :, :])
    distance, _ = distance_and_ttc(_NO_CONE, left + offset_m * _UP, _UP, v[..., :-1, :, :])
    return distance, ttc


def simulate_map(
    simulation: Simulation, n: int, rng: np.random.Generator, params: MemoryParams, reference: Reference = "taxel"
) -> PPSMemory:
    """Return R's map of the taxels after n objects; memory in use does not grow with n."""
    memory = empty_map(len(simulation.taxels_m), params)
    for first in range(0, n, _CHUNK):
        paths = sample_paths(simulation, min(_CHUNK, n - first), rng)
        at_landing = reference == "landing"
        D, TTC = from_landing(paths.d_m, paths.v_m_s, simulation.offset_m) if at_landing else from_taxel(paths)
        memory = count_paths(memory, D, TTC, paths.touched)
    return memory


def empty_map(n: int, params: MemoryParams) -> PPSMemory:
    """Return a map of n taxels of one body part without samples."""
    return PPSMemory(tuple(map(str, range(n))), np.zeros(n, np.intp), np.zeros((n, *params.bins, 2), np.int64), params)


def count_paths(memory: PPSMemory, D: Array, TTC: Array, touched: Mask) -> PPSMemory:
    """Return the map with the samples D and TTC (N, T, n) of N objects counted; those that touch nothing count for
    nothing (R, "Data collection"). Objects that touch the same taxels are counted together."""
    for pattern in np.unique(touched[touched.any(axis=1)], axis=0):
        same = np.all(touched == pattern, axis=1)
        n = len(pattern)
        memory = count_samples(memory, D[same].reshape(-1, n), TTC[same].reshape(-1, n), pattern)
    return memory
