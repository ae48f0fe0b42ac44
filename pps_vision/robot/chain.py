"""Forward kinematics and Jacobians of one serial chain at many postures at once (NumPy or torch).

Product of exponentials: the joints' screw axes are read once from Pinocchio at a base posture,
so any robot and any subset of its joints will do; joints left out stay at the base posture.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from array_api_compat import array_namespace, is_torch_array
from numpy.typing import ArrayLike

from pps_vision.robot import compiled
from pps_vision.robot.model import Robot
from pps_vision.types import Array


@dataclass(frozen=True)
class Chain:
    """`k` joints moving one frame: `screws` (k, 6) are (v, ω) in the root frame with the chain's
    joints at zero, ordered from root to tip as `order` says; `T_root_frame` is the frame then."""

    joints: tuple[str, ...]
    order: tuple[int, ...]
    screws: Array
    T_root_frame: Array

    @classmethod
    def of(cls, robot: Robot, joints: tuple[str, ...], frame: str, q_base: ArrayLike | None = None) -> "Chain":
        """The chain of the named joints that ends at `frame`, other joints at `q_base` (default
        zero); ValueError for an unknown joint or frame."""
        indices = robot.indices(joints)
        q = np.zeros(robot.n_joints) if q_base is None else np.array(q_base, dtype=float)
        q[indices] = 0.0
        T_root_frame = robot.at(q).T_root(frame)
        model, data = robot.model, robot.model.createData()
        J = pin.computeFrameJacobian(model, data, q, robot.frame_ids[frame], pin.ReferenceFrame.WORLD)
        order = tuple(int(i) for i in np.argsort(indices))  # Pinocchio numbers parents before children
        return cls(joints, order, J.T[indices], T_root_frame)

    def frames(self, q_rad: ArrayLike) -> tuple[Array, Array]:
        """Rotations (N, 3, 3) and origins (N, 3) in m of the frame at postures `q_rad` (N, k)."""
        q = self._checked(q_rad)
        rotation, shift, _ = self._move(q)
        T = _like(q, self.T_root_frame)
        return rotation @ T[:3, :3], rotation @ T[:3, 3] + shift

    def positions(self, q_rad: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Where a `point` (3,) of the frame is, (N, 3) m, and its Jacobian (N, 3, k) m/rad."""
        q = self._checked(q_rad)
        at_zero = self.T_root_frame[:3, :3] @ np.asarray(point, dtype=float) + self.T_root_frame[:3, 3]
        if isinstance(q, np.ndarray):
            return compiled.positions(
                np.ascontiguousarray(self.screws), np.array(self.order), at_zero, np.ascontiguousarray(q)
            )
        rotation, shift, moved = self._move(q)
        p = rotation @ _like(q, at_zero) + shift
        columns = [v + _cross(w, p) for v, w in (moved[i] for i in range(len(self.joints)))]
        return p, array_namespace(q).stack(columns, axis=-1)

    def _checked(self, q_rad: ArrayLike) -> Array:
        q: Any = q_rad if is_torch_array(q_rad) else np.asarray(q_rad, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.joints):
            raise ValueError(f"postures of shape {q.shape}: expected (N, {len(self.joints)}), one column a joint")
        return q

    def _move(self, q: Array) -> tuple[Array, Array, dict[int, tuple[Array, Array]]]:
        """The displacement (R, t) that the joints cause, and each joint's screw after the joints before it."""
        xp = array_namespace(q)
        R = xp.broadcast_to(_like(q, np.eye(3)), (len(q), 3, 3))
        t = xp.zeros_like(R[:, 0])
        moved: dict[int, tuple[Array, Array]] = {}
        for i in self.order:
            x, y, z = self.screws[i, 3:]
            K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            v, w = self.screws[i, :3, None], self.screws[i, 3:, None]
            # all that R is multiplied with from the right, in one product of (3N, 3) with (3, 10)
            right = R.reshape(-1, 3) @ _like(q, np.hstack([K, K @ K, v, w, K @ v, K @ K @ v]))
            RK, RKK, (Rv, Rw, RKv, RKKv) = _parted(right.reshape(-1, 3, 10))
            angle = q[:, i, None]
            sine, versine = xp.sin(angle), 1 - xp.cos(angle)
            moved[i] = Rv + _cross(t, Rw), Rw
            t = t + angle * Rv + versine * RKv + (angle - sine) * RKKv
            R = R + sine[..., None] * RK + versine[..., None] * RKK
        return R, t, moved


def _parted(right: Array) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """Two matrices (N, 3, 3) and four vectors (N, 3) that stand side by side."""
    return right[..., :3], right[..., 3:6], (right[..., 6], right[..., 7], right[..., 8], right[..., 9])


def _like(q: Array, constant: Array) -> Array:
    """A constant as an array of q's kind."""
    if isinstance(q, np.ndarray):
        return constant
    return array_namespace(q).asarray(constant, dtype=q.dtype, device=q.device)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of (N, 3) arrays; np.cross takes several times as long."""
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return array_namespace(a).stack([x, y, z], axis=1)
