"""Forward kinematics and Jacobians of one serial chain at many postures at once (NumPy).

Product of exponentials: the joints' screw axes are read once from Pinocchio at a base posture,
so any robot and any subset of its joints will do; joints left out stay at the base posture.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

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
        rotation, shift, _ = self._move(self._checked(q_rad))
        return rotation @ self.T_root_frame[:3, :3], rotation @ self.T_root_frame[:3, 3] + shift

    def positions(self, q_rad: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Where a `point` (3,) of the frame is, (N, 3) m, and its Jacobian (N, 3, k) m/rad."""
        rotation, shift, moved = self._move(self._checked(q_rad))
        p = rotation @ (self.T_root_frame[:3, :3] @ np.asarray(point, dtype=float) + self.T_root_frame[:3, 3]) + shift
        J = np.empty((*p.shape, len(self.joints)))
        for i, (v, w) in moved.items():
            J[..., i] = v + _cross(w, p)
        return p, J

    def _checked(self, q_rad: ArrayLike) -> Array:
        q = np.asarray(q_rad, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.joints):
            raise ValueError(f"postures of shape {q.shape}: expected (N, {len(self.joints)}), one column a joint")
        return q

    def _move(self, q: Array) -> tuple[Array, Array, dict[int, tuple[Array, Array]]]:
        """The displacement (R, t) that the joints cause, and each joint's screw after the joints before it."""
        R: Array = np.tile(np.eye(3), (len(q), 1, 1))
        t: Array = np.zeros((len(q), 3))
        moved: dict[int, tuple[Array, Array]] = {}
        for i in self.order:
            v, w = self.screws[i, :3], self.screws[i, 3:]
            K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
            angle = q[:, i, None]
            sine, versine = np.sin(angle), 1 - np.cos(angle)
            RK, Rv, Rw = R @ K, R @ v, R @ w
            RKK = RK @ K
            moved[i] = Rv + _cross(t, Rw), Rw
            t = t + angle * Rv + versine * (RK @ v) + (angle - sine) * (RKK @ v)
            R = R + sine[..., None] * RK + versine[..., None] * RKK
        return R, t, moved


def _cross(a: Array, b: Array) -> Array:
    """Cross product of (N, 3) arrays; np.cross takes several times as long."""
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.stack([x, y, z], axis=1)
