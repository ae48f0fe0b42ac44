"""Arm posture → what the eyes fixate, exact from a hundred samples, for joints that turn.

Whatever an arm of revolute joints looks like, the place of its hand is linear in the products of 1, cos and sin of
the joints' angles.  The eyes see it from a head that the neck carries about: where the lines of sight cross is that
place but for C(gaze) o, where o says where eyes and neck stand to one another and does not change.  So
Φ(arm) W = crossing(gaze) + C(gaze) o is linear in all that is unknown, and sums over the samples are all to keep.
"""

import numpy as np

from learning.babbling import crossing, gaze_at
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.types import Array

_RIDGE = 1e-12
_ANYWHERE = GazeLimits((-1.5, 1.5), (-1.5, 1.5), (0.01, 2.5))
_FINE = IKParams(tolerance=1e-9, max_steps=30)


class TurningJoints:
    """Learns where the hand is from arm postures (N, k) in rad and the gaze postures (N, 3) that fixate it.

    Places are in units of the distance between the eyes times `eyes_apart_m`, seen from the neck.  Samples count by
    1/distance⁴, as sure as an error of the vergence leaves them."""

    def __init__(self, n_joints: int = 4, eyes_apart_m: float = 0.068) -> None:
        self.n_joints, self.eyes_apart_m = n_joints, eyes_apart_m
        m = 3**n_joints
        self._n, self._AA, self._AZ, self._ZZ = 0, np.zeros((m, m)), np.zeros((m, 3, 5)), np.zeros((5, 5))
        self._known: tuple[Array, Array] | None = None

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """From any number of samples; the order does not matter."""
        Z = np.concatenate([crossing(gaze_rad)[:, :, None], _carried(gaze_rad)], axis=2)
        weight = 1 / np.linalg.norm(Z[:, :, 0], axis=1) ** 2
        A, Z = _products(self._bases(arm_rad)) * weight[:, None], Z * weight[:, None, None]
        self._n += len(A)
        self._AA += A.T @ A
        self._AZ += np.tensordot(A, Z, axes=(0, 0))
        self._ZZ += np.tensordot(Z, Z, axes=((0, 1), (0, 1)))
        self._known = None

    @property
    def nbytes(self) -> int:
        """Of what it keeps."""
        return self._AA.nbytes + self._AZ.nbytes + self._ZZ.nbytes

    def _fitted(self) -> tuple[Array, Array]:
        """W (3^k, 3) and o (4,) of the least squares; ValueError before the second sample."""
        if self._n < 2:
            raise ValueError(f"{self._n} samples: expected at least two to learn from")
        if self._known is None:
            m = len(self._AA)
            X = np.linalg.solve(self._AA + _RIDGE * np.trace(self._AA) / m * np.eye(m), self._AZ.reshape(m, -1))
            left = self._ZZ - np.tensordot(self._AZ, X.reshape(m, 3, 5), axes=((0, 1), (0, 1)))
            o = -np.linalg.lstsq(left[1:, 1:], left[1:, 0], rcond=None)[0]
            self._known = X.reshape(m, 3, 5) @ np.append(1.0, o), o
        return self._known

    def forward(self, arm_rad: Array) -> tuple[Array, Array]:
        """Places of the hand (N, 3) m, and their derivatives by the joints (N, 3, k)."""
        W, bases = self.eyes_apart_m * self._fitted()[0], self._bases(arm_rad)
        slopes = [np.stack([0 * b[:, 0], -b[:, 2], b[:, 1]], axis=1) for b in bases]
        half = self.n_joints // 2
        first, second = _products(bases[:half]), _products(bases[half:])
        W = W.reshape(first.shape[1], -1)

        def place(first: Array, second: Array) -> Array:
            there: Array = (second[:, None] @ (first @ W).reshape(len(first), -1, 3))[:, 0]
            return there

        columns = []
        for k in range(self.n_joints):
            turned = [*bases[:k], slopes[k], *bases[k + 1 :]]
            columns.append(
                place(_products(turned[:half]), second) if k < half else place(first, _products(turned[half:]))
            )
        return place(first, second), np.stack(columns, axis=2)

    def points(self, gaze_rad: Array) -> Array:
        """(N, 3) m: the places that gaze postures (N, 3) fixate."""
        return self.eyes_apart_m * (crossing(gaze_rad) + _carried(gaze_rad) @ self._fitted()[1])

    def gaze(self, points: Array, limits: GazeLimits = _ANYWHERE) -> Array:
        """(N, 3) rad: the gaze postures that fixate places (N, 3); NaN where the limits forbid it."""

        def forward(gaze: Array) -> tuple[Array, Array]:
            h = 1e-7
            here, *there = self.points(np.concatenate([gaze, *(gaze + h * axis for axis in np.eye(3))])).reshape(
                4, -1, 3
            )
            return here, (np.stack(there, axis=2) - here[:, :, None]) / h

        starts = np.clip(gaze_at(points / self.eyes_apart_m), limits.lower, limits.upper)[None]
        found = solve_ik(forward, points, starts, limits.lower, limits.upper, _FINE)
        return np.where(found.converged[:, None], found.q_rad, np.nan)

    def __call__(self, arm_rad: Array) -> Array:
        """Gaze postures (N, 3) for arm postures (N, k)."""
        return self.gaze(self.forward(arm_rad)[0])

    def _bases(self, arm_rad: Array) -> list[Array]:
        """(N, 3) of each joint: 1, cos, sin."""
        if arm_rad.ndim != 2 or arm_rad.shape[1] != self.n_joints:
            raise ValueError(f"arm postures of shape {arm_rad.shape}: expected (N, {self.n_joints})")
        return [np.stack([np.ones_like(q), np.cos(q), np.sin(q)], axis=1) for q in arm_rad.T]


def _products(bases: list[Array]) -> Array:
    """(N, 3^k) all products of one of each (N, 3)."""
    products = bases[0]
    for basis in bases[1:]:
        products = (products[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    return products


def _carried(gaze_rad: Array) -> Array:
    """(N, 3, 4) ahead of the face, to its right and up, and ahead of the neck where only its pitch has turned."""
    yaw, pitch, _ = gaze_rad.T
    cy, sy, cp, sp, none = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.zeros(len(yaw))
    axes = [(sy, cy * sp, cy * cp), (cy, -sy * sp, -sy * cp), (none, cp, -sp), (none, sp, cp)]
    return np.stack([np.stack(axis, axis=1) for axis in axes], axis=2)
