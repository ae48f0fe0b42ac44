"""Forward kinematics and Jacobians of one serial chain at many postures at once, compiled by numba.

Product of exponentials: the joints' screw axes are read once from Pinocchio at a base posture, for any robot and any
subset of its joints; the other joints stay at the base posture.  The first call compiles the kernel, once per
installation.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Chain:
    """Joints that move one frame of a robot."""

    joints: tuple[str, ...]  # names of the k joints; postures have one column each
    order: tuple[int, ...]  # the columns from root to tip
    screws: Array  # (k, 6) (v, ω) of each joint in the root frame with the chain's joints at zero
    T_root_frame: Array  # (4, 4) pose of the frame with the chain's joints at zero
    gains: Array | None = None  # (m, k) positions of m screws by the k joints', where others follow them

    def frames(self, q_rad: ArrayLike) -> tuple[Array, Array]:
        """Rotations (N, 3, 3) and origins (N, 3) in m of the frame at postures `q_rad` (N, k)."""
        T, _ = self._forward(q_rad, self.T_root_frame)
        return T[:, :3, :3], T[:, :3, 3]

    def positions(self, q_rad: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Positions (N, 3) in m of a `point` (3,) of the frame, and their Jacobians (N, 3, k) in m/rad."""
        T_zero = self.T_root_frame.copy()
        T_zero[:3, 3] += T_zero[:3, :3] @ np.asarray(point, dtype=float)
        T, J = self._forward(q_rad, T_zero)
        return T[:, :3, 3], J

    def pose(self, q_rad: Array) -> Array:
        """`T_root_frame` (4, 4) at one posture (k,)."""
        return np.asarray(self._forward(q_rad[None], self.T_root_frame)[0][0])

    @cached_property
    def _order(self) -> NDArray[np.intp]:
        return np.array(self.order, dtype=np.intp)

    def _forward(self, q_rad: ArrayLike, T_zero: Array) -> tuple[Array, Array]:
        q = np.ascontiguousarray(q_rad, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.joints):
            raise ValueError(f"postures of shape {q.shape}: expected (N, {len(self.joints)}), one column a joint")
        if self.gains is None:
            return _forward(self.screws, self._order, T_zero, q)
        T, J = _forward(self.screws, self._order, T_zero, q @ self.gains.T)
        return T, J @ self.gains


@njit(cache=True, error_model="numpy")
def _forward(screws: Array, order: NDArray[np.intp], T_zero: Array, q: Array) -> tuple[Array, Array]:
    """Poses (N, 4, 4) of a frame at postures (N, k), and Jacobians (N, 3, k) of its origin.

    T(q) = exp(ξ₁q₁) … exp(ξₖqₖ) T(0), ξ = (v, ω) with |ω| = 1, or ω = 0 for a joint that slides.  Each screw is moved
    by the joints before it: v' = R v + t × ω', ω' = R ω; and ∂p/∂q = v' + ω' × p.
    """
    n, k = q.shape
    poses = np.zeros((n, 4, 4))
    jacobians = np.empty((n, 3, k))
    axes = np.empty((k, 3))
    for row in range(n):
        x = (1.0, 0.0, 0.0)  # the columns of R
        y = (0.0, 1.0, 0.0)
        z = (0.0, 0.0, 1.0)
        t = (0.0, 0.0, 0.0)
        for i in order:
            v = _combined(x, y, z, screws[i, 0], screws[i, 1], screws[i, 2])
            w = _combined(x, y, z, screws[i, 3], screws[i, 4], screws[i, 5])
            moment = _cross(t, w)
            for axis in range(3):
                jacobians[row, axis, i] = v[axis] + moment[axis]
                axes[i, axis] = w[axis]
            angle = q[row, i]
            sine = sin(angle)
            versine = 1 - cos(angle)
            wv = _cross(w, v)
            dt = _combined(v, wv, _cross(w, wv), angle, versine, angle - sine)
            t = (t[0] + dt[0], t[1] + dt[1], t[2] + dt[2])
            x = _rotated(w, x, sine, versine)
            y = _rotated(w, y, sine, versine)
            z = _rotated(w, z, sine, versine)
        for column in range(4):
            a = _combined(x, y, z, T_zero[0, column], T_zero[1, column], T_zero[2, column])
            for axis in range(3):
                poses[row, axis, column] = a[axis] + (t[axis] if column == 3 else 0.0)
        poses[row, 3, 3] = 1.0
        p = (poses[row, 0, 3], poses[row, 1, 3], poses[row, 2, 3])
        for i in range(k):
            turning = _cross((axes[i, 0], axes[i, 1], axes[i, 2]), p)
            for axis in range(3):
                jacobians[row, axis, i] += turning[axis]
    return poses, jacobians


@njit(cache=True, error_model="numpy")
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def _combined(a: Vector, b: Vector, c: Vector, k: float, m: float, n: float) -> Vector:
    """k a + m b + n c."""
    return k * a[0] + m * b[0] + n * c[0], k * a[1] + m * b[1] + n * c[1], k * a[2] + m * b[2] + n * c[2]


@njit(cache=True, error_model="numpy")
def _rotated(w: Vector, a: Vector, sine: float, versine: float) -> Vector:
    """a + sin q · ω × a + (1 − cos q) · ω × (ω × a), Rodrigues."""
    wa = _cross(w, a)
    return _combined(a, wa, _cross(w, wa), 1.0, sine, versine)
