"""Forward model arm posture → gaze posture for revolute joints, exact from a hundred exact samples.

The position of the hand is linear in the products Φ of 1, cos q and sin q of the joint angles.  The eyes see it from a
head that the neck carries: the lines of sight cross there but for C(gaze) o, where o holds the constant offsets between
eyes and neck.  So Φ(arm) W = crossing(gaze) + C(gaze) o is linear in the unknown W and o, which gives a first estimate;
the noise is in the gaze, so that both are then fitted in its angles.  Outliers (another point fixated, an encoder
stuck) get little weight.
"""

import numpy as np

from learning.reach.babbling import crossing, gaze_at
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.types import Array

_LINEAR_ROUNDS, _FIXED_ROUNDS, _FREE_ROUNDS = 20, 10, 4  # iterations of each kind until they converge
_NO_ERROR = 1e-9  # residuals below this count as this
_PRIOR_STD = 1.0  # eye distances, of every coefficient; 0.5 to 2 measured on 20 simulated arms with other end points
_WIDE = GazeLimits((-1.5, 1.5), (-1.5, 1.5), (0.01, 2.5))
_FINE = IKParams(tolerance=1e-9, max_steps=30)


class RevoluteArm:
    """Learns the position of the hand from arm postures (N, k) in rad and the gaze postures (N, 3) that fixate it.

    Positions are seen from the neck and measured in eye distances; `eyes_apart_m` scales them to metres."""

    def __init__(self, n_joints: int = 4, eyes_apart_m: float = 0.068) -> None:
        self.n_joints, self.eyes_apart_m = n_joints, eyes_apart_m
        self._samples: list[tuple[Array, Array]] = []
        self._known: tuple[Array, Array] | None = None

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """Add samples; their order does not matter."""
        self._samples.append((arm_rad, gaze_rad))
        self._known = None

    def _fitted(self) -> tuple[Array, Array]:
        """W (3^k, 3) and o (4,), fitted when first asked for; ValueError before the second sample.

        First the least sum of distances, by iteratively reweighted least squares, on which outliers have little
        influence; then Gauss–Newton steps in the angles of the gaze with Geman–McClure weights.  Both have the prior
        W, o ~ N(0, _PRIOR_STD²) and estimate the noise variance from the median residual."""
        if self._known is None:
            n = sum(len(arm) for arm, _ in self._samples)
            if n < 2:
                raise ValueError(f"{n} samples: expected at least two to learn from")
            arm, gaze = (np.concatenate(parts) for parts in zip(*self._samples, strict=True))
            Z = np.concatenate([crossing(gaze)[:, :, None], _carried(gaze)], axis=2)
            A, weight = _products(self._bases(arm)), np.ones(n)
            spread = np.median(np.linalg.norm(Z[:, :, 0] - np.median(Z[:, :, 0], axis=0), axis=1))
            noise = spread**2 / 3  # variance of a coordinate before the first estimate
            for _ in range(_LINEAR_ROUNDS):
                W, o = _least_squares(A, Z, weight, noise / _PRIOR_STD**2)
                off = np.linalg.norm(Z[:, :, 0] + Z[:, :, 1:] @ o - A @ W, axis=1)
                middle = np.median(off) + _NO_ERROR
                weight, noise = 1 / np.maximum(off, 0.1 * middle), middle / 3  # the variance times the weight
            seen = gaze
            for k in range(_FIXED_ROUNDS + _FREE_ROUNDS):
                W, o, seen = _gauss_newton(A, gaze, W, o, seen, moves=k >= _FIXED_ROUNDS)
            self._known = W, o
        return self._known

    def forward(self, arm_rad: Array) -> tuple[Array, Array]:
        """Positions of the hand (N, 3) m, and their Jacobians by the joints (N, 3, k)."""
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
        """(N, 3) m: the points that gaze postures (N, 3) fixate."""
        return self.eyes_apart_m * (crossing(gaze_rad) + _carried(gaze_rad) @ self._fitted()[1])

    def gaze(self, points: Array, limits: GazeLimits = _WIDE) -> Array:
        """(N, 3) rad: the gaze postures that fixate points (N, 3); NaN where the limits forbid it."""
        o, eyes = self._fitted()[1], self.eyes_apart_m

        def forward(gaze: Array) -> tuple[Array, Array]:
            place, slope = _fixated(gaze, o)
            return eyes * place, eyes * slope

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


def _least_squares(A: Array, Z: Array, weight: Array, prior: float) -> tuple[Array, Array]:
    """W (m, 3) and o (4,) of the least Σ weight |A W − Z (1, o)|² + prior (|W|² + |o|²): A (N, m), Z (N, 3, 5)."""
    m, weighted = A.shape[1], Z * weight[:, None, None]
    AA, AZ = (A * weight[:, None]).T @ A, np.tensordot(A, weighted, axes=(0, 0))
    X = np.linalg.solve(AA + prior * np.eye(m), AZ.reshape(m, -1)).reshape(AZ.shape)
    left = np.tensordot(Z, weighted, axes=((0, 1), (0, 1))) - np.tensordot(AZ, X, axes=((0, 1), (0, 1)))
    o = -np.linalg.solve(left[1:, 1:] + prior * np.eye(4), left[1:, 0])
    return X @ np.append(1.0, o), o


def _gauss_newton(A: Array, gaze: Array, W: Array, o: Array, seen: Array, moves: bool) -> tuple[Array, Array, Array]:
    """One Gauss–Newton step of W (m, 3) and o (4,) towards the observed gaze postures (N, 3).

    Linearised about `seen` (N, 3), the gaze that the previous W and o predict; returned updated.  The head stays at
    `seen`, which converges from far, or `moves` with the predicted gaze, which converges faster."""
    carried = _carried(seen)
    seen = gaze_at(A @ W - carried @ o)
    place, slope = _fixated(seen, o if moves else np.zeros(4))
    G = np.linalg.inv(slope)  # ∂gaze/∂place
    if moves:
        nearer = seen + (G @ (A @ W - place)[..., None])[..., 0]
        seen = np.clip(nearer, _WIDE.lower, _WIDE.upper)
        carried = _carried(seen)
    off = np.linalg.norm(gaze - seen, axis=1)
    middle = np.median(off) + _NO_ERROR
    weight = 1 / (1 + (off / (4 * middle)) ** 2)  # its square weighs the squares
    H = np.concatenate([(A[:, None, :, None] * G[:, :, None]).reshape(len(A), 3, -1), -G @ carried], axis=2)
    H, left = (H * weight[:, None, None]).reshape(-1, H.shape[2]), ((gaze - seen) * weight[:, None]).ravel()
    known, HH = np.append(W.ravel(), o), H.T @ H
    n = len(known)
    prior = (middle**2 / 3) / _PRIOR_STD**2  # noise variance over prior variance
    known = known + np.linalg.solve(HH + prior * np.eye(n), H.T @ left - prior * known)
    return known[:-4].reshape(W.shape), known[-4:], seen


def _fixated(gaze_rad: Array, o: Array) -> tuple[Array, Array]:
    """Points (N, 3) that gaze postures (N, 3) fixate, in eye distances, and their Jacobians (N, 3, 3)."""
    h = 1e-7
    asked = np.concatenate([gaze_rad, *(gaze_rad + h * axis for axis in np.eye(3))])
    here, *there = (crossing(asked) + _carried(asked) @ o).reshape(4, -1, 3)
    return here, (np.stack(there, axis=2) - here[:, :, None]) / h


def _products(bases: list[Array]) -> Array:
    """(N, 3^k) all products of one of each (N, 3)."""
    products = bases[0]
    for basis in bases[1:]:
        products = (products[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    return products


def _carried(gaze_rad: Array) -> Array:
    """(N, 3, 4) C: unit vectors ahead of the face, to its right and up, and ahead of the neck after its pitch."""
    yaw, pitch, _ = gaze_rad.T
    cy, sy, cp, sp, none = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.zeros(len(yaw))
    axes = [(sy, cy * sp, cy * cp), (cy, -sy * sp, -sy * cp), (none, cp, -sp), (none, sp, cp)]
    return np.stack([np.stack(axis, axis=1) for axis in axes], axis=2)
