"""Straight paths."""

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Array

_SLOWEST_M2_S2 = 1e-12  # squared speed of an object at rest


def passing_distances(points: Array, position: Array, velocity: Array, horizon_s: ArrayLike = np.inf) -> Array:
    """Smallest distances (…, n) m of points (n, 3) from positions (…, 3) that move at velocities (…, 3) for times
    (…)."""
    d = points - position[..., None, :]
    speed2 = np.maximum(np.sum(velocity * velocity, axis=-1), _SLOWEST_M2_S2)[..., None]
    nearest_s = np.clip(np.einsum("...nj,...j->...n", d, velocity) / speed2, 0.0, np.asarray(horizon_s)[..., None])
    return np.asarray(np.linalg.norm(d - nearest_s[..., None] * velocity[..., None, :], axis=-1))


def arrival_s(points: Array, position: Array, velocity: Array, distance_m: float) -> Array:
    """Times (…) s after which positions (…, 3) that move at velocities (…, 3) first come within a distance of one of
    the points (n, 3): 0 while they approach one nearer than that, inf if they never do."""
    d = points - position[..., None, :]
    speed2 = np.maximum(np.sum(velocity * velocity, axis=-1), _SLOWEST_M2_S2)[..., None]
    towards = np.einsum("...nj,...j->...n", d, velocity)
    root = towards**2 - speed2 * (np.sum(d * d, axis=-1) - distance_m**2)
    times = np.maximum(towards - np.sqrt(np.maximum(root, 0.0)), 0.0) / speed2
    return np.asarray(np.min(times, axis=-1, where=(root >= 0) & (towards > 0), initial=np.inf))
