"""Straight paths."""

import numpy as np

from pps_vision.types import Array


def passing_distances(points: Array, position: Array, velocity: Array, horizon_s: float = np.inf) -> Array:
    """Smallest distances (…, n) m of points (n, 3) from positions (…, 3) that move at velocities (…, 3) for a time."""
    d = points - position[..., None, :]
    speed2 = np.maximum(np.sum(velocity * velocity, axis=-1), 1e-12)[..., None]
    nearest_s = np.clip(np.einsum("...nj,...j->...n", d, velocity) / speed2, 0.0, horizon_s)
    return np.asarray(np.linalg.norm(d - nearest_s[..., None] * velocity[..., None, :], axis=-1))
