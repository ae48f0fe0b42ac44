"""Rigid transforms as 4×4 matrices: `p_root = T_root_left @ p_left`, neighbouring names cancel."""

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Array


def transform(rotation: ArrayLike | None = None, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """4×4 transform of a 3×3 rotation (identity if None) and a translation (3,) in metres."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    T[:3, 3] = translation
    return T


def inverse(T_a_b: Array) -> Array:
    """`T_b_a` of a rigid `T_a_b` (…, 4, 4)."""
    R_t = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    T_b_a = np.zeros_like(T_a_b)
    T_b_a[..., :3, :3] = R_t
    T_b_a[..., :3, 3] = -(R_t @ T_a_b[..., :3, 3:])[..., 0]
    T_b_a[..., 3, 3] = 1.0
    return T_b_a


def move_points(T_a_b: Array, points_b: ArrayLike) -> Array:
    """Points (…, 3) given in frame b, in frame a."""
    return np.asarray(points_b, dtype=float) @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def rotation_to(direction: ArrayLike) -> Array:
    """A rotation (3, 3) whose z axis points along `direction` (3,); the other two are any."""
    z = np.asarray(direction, dtype=float)
    norm = np.linalg.norm(z)
    if not np.isfinite(norm) or norm == 0:
        raise ValueError(f"direction {tuple(z)} has no length; expected a non-zero vector")
    z = z / norm
    helper = np.eye(3)[np.argmin(np.abs(z))]
    x = _cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, _cross(z, x), z])


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,); `np.cross` takes 27 times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
