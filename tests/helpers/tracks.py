"""Tracks whose place is given."""

from collections.abc import Sequence

import numpy as np

from pps_vision.types import Array, Status, Track3D


def track_at(
    position: Array | Sequence[float],
    velocity: Array | Sequence[float] = (0.0, 0.0, 0.0),
    stamp_s: float = 0.0,
    cov: Array | float = 1e-6,
    radius_m: float = 0.03,
    status: Status = Status.TRACKING,
    track_id: int = 1,
) -> Track3D:
    """A track without acceleration, its radius certain to 1 mm; `cov` is (12, 12), or one variance of everything."""
    mean = np.array([position, velocity, np.zeros(3), np.zeros(3)], dtype=float)
    full_cov = np.eye(12) * cov if np.ndim(cov) == 0 else np.asarray(cov)
    return Track3D(stamp_s, mean, full_cov, radius_m, 1e-6, status, track_id)
