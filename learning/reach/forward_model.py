"""Forward model arm posture → gaze posture for revolute joints, exact from a hundred samples of an exact robot.

The position of the hand is linear in the products Φ of 1, cos q and sin q of the joint angles.  The eyes see it from a
head that the neck carries: the lines of sight cross there but for C(gaze) o, where o holds the constant offsets between
eyes and neck.  So Φ(arm) W = crossing(gaze) + C(gaze) o is linear in the unknown W and o, which gives a first estimate;
the noise is in the gaze, so that both are then fitted in its angles.  Outliers (another point fixated, an encoder
stuck) get little weight.  A neck that yaws first is the same with yaw and pitch exchanged.  What such a robot cannot do
(sag, errors of gears, cross-talk) is left to a Gaussian process of the arm posture, `learning/reach/residual.py`.
"""

from typing import NamedTuple

import numpy as np

from learning.reach.babbling import crossing, gaze_at
from learning.reach.residual import Residual, fit_residual
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.types import Array

_LINEAR_ROUNDS, _FIXED_ROUNDS, _FREE_ROUNDS = 20, 10, 4  # iterations of each kind until they converge
_N_JOINTS = 4  # of the arm (J)
_EYES_APART_M = 0.068
_NO_ERROR = 1e-9  # residuals below this count as this
_PRIOR_STD = 1.0  # eye distances, of every coefficient; 0.5 to 2 measured on 20 simulated arms with other end points
_WIDE = GazeLimits((-1.5, 1.5), (-1.5, 1.5), (0.01, 2.5))
_FINE = IKParams(tolerance=1e-9, max_steps=30)
_ORDERS = ((0, 1, 2), (1, 0, 2))  # of yaw, pitch, vergence: a neck that pitches first (the iCub's), or yaws first
_SURE = 5.0  # standard deviations by which more than half of the samples must fit the second order better
_NEGLIGIBLE_RAD = 1e-5  # a median residual of 0.0006° is left as it is


class _Fit(NamedTuple):
    """W (3^k, 3), o (4,), the order of the neck's joints, and what the process adds to Φ W."""

    W: Array
    o: Array
    order: tuple[int, ...]
    residual: Residual | None


class RevoluteArm:
    """Learns the position of the hand from arm postures (N, k) in rad and the gaze postures (N, 3) that fixate it.

    Positions are seen from the neck and measured in eye distances; `_EYES_APART_M` scales them to metres.  `corrected`:
    with the process, where there is evidence for it."""

    def __init__(self, corrected: bool = True) -> None:
        self.corrected = corrected
        self._samples: list[tuple[Array, Array]] = []
        self._known: _Fit | None = None

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """Add samples in the order of their measurement, of which blocks are the evidence for the process."""
        self._samples.append((arm_rad, gaze_rad))
        self._known = None

    def _fitted(self) -> _Fit:
        """The model of all samples, fitted when first asked for; ValueError before the second sample."""
        if self._known is None:
            n = sum(len(arm) for arm, _ in self._samples)
            if n < 2:
                raise ValueError(f"{n} samples: expected at least two to learn from")
            arm, gaze = (np.concatenate(parts) for parts in zip(*self._samples, strict=True))
            A = _products(self._bases(arm))
            (left, found), (left_other, other) = (_structure(A, gaze, order) for order in _ORDERS)
            if 2 * np.mean(left_other < left) - 1 > _SURE / np.sqrt(n):
                left, found = left_other, other
            if self.corrected and np.median(left) > _NEGLIGIBLE_RAD:
                seen = gaze[:, found.order]
                place, slope = _fixated(seen, found.o)
                found = found._replace(residual=fit_residual(arm, place - A @ found.W, np.linalg.inv(slope)))
            self._known = found
        return self._known

    def forward(self, arm_rad: Array) -> tuple[Array, Array]:
        """Positions of the hand (N, 3) m, and their Jacobians by the joints (N, 3, k)."""
        known, bases = self._fitted(), self._bases(arm_rad)
        W = _EYES_APART_M * known.W
        slopes = [np.stack([0 * b[:, 0], -b[:, 2], b[:, 1]], axis=1) for b in bases]
        half = _N_JOINTS // 2
        first, second = _products(bases[:half]), _products(bases[half:])
        W = W.reshape(first.shape[1], -1)

        def place(first: Array, second: Array) -> Array:
            there: Array = (second[:, None] @ (first @ W).reshape(len(first), -1, 3))[:, 0]
            return there

        columns = []
        for k in range(_N_JOINTS):
            turned = [*bases[:k], slopes[k], *bases[k + 1 :]]
            columns.append(
                place(_products(turned[:half]), second) if k < half else place(first, _products(turned[half:]))
            )
        position, J = place(first, second), np.stack(columns, axis=2)
        if known.residual is None:
            return position, J
        value, slope = known.residual(arm_rad)
        return position + _EYES_APART_M * value, J + _EYES_APART_M * slope

    def points(self, gaze_rad: Array) -> Array:
        """(N, 3) m: the points that gaze postures (N, 3) fixate."""
        known = self._fitted()
        seen = gaze_rad[:, known.order]
        return _EYES_APART_M * (crossing(seen) + _carried(seen) @ known.o)

    def gaze(self, points: Array, limits: GazeLimits = _WIDE) -> Array:
        """(N, 3) rad: the gaze postures that fixate points (N, 3); NaN where the limits forbid it."""
        known, eyes = self._fitted(), _EYES_APART_M

        def forward(gaze: Array) -> tuple[Array, Array]:
            place, slope = _fixated(gaze, known.o)
            return eyes * place, eyes * slope

        lower, upper = limits.lower[list(known.order)], limits.upper[list(known.order)]
        starts = np.clip(gaze_at(points / eyes), lower, upper)[None]
        found = solve_ik(forward, points, starts, lower, upper, _FINE)
        return np.where(found.converged[:, None], found.q_rad[:, known.order], np.nan)  # each order is its own inverse

    def __call__(self, arm_rad: Array) -> Array:
        """Gaze postures (N, 3) for arm postures (N, k)."""
        return self.gaze(self.forward(arm_rad)[0])

    def _bases(self, arm_rad: Array) -> list[Array]:
        """(N, 3) of each joint: 1, cos, sin."""
        if arm_rad.ndim != 2 or arm_rad.shape[1] != _N_JOINTS:
            raise ValueError(f"arm postures of shape {arm_rad.shape}: expected (N, {_N_JOINTS})")
        return [np.stack([np.ones_like(q), np.cos(q), np.sin(q)], axis=1) for q in arm_rad.T]


def _structure(A: Array, gaze: Array, order: tuple[int, ...]) -> tuple[Array, _Fit]:
    """The residuals (N,) rad of the robot with one order of the neck's joints, and the robot.

    First the least sum of distances, by iteratively reweighted least squares, on which outliers have little
    influence; then Gauss–Newton steps in the angles of the gaze with Geman–McClure weights.  Both have the prior
    W, o ~ N(0, _PRIOR_STD²) and estimate the noise variance from the median residual."""
    gaze = gaze[:, order]
    Z, weight = np.concatenate([crossing(gaze)[:, :, None], _carried(gaze)], axis=2), np.ones(len(A))
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
    return np.linalg.norm(gaze - gaze_at(A @ W - _carried(seen) @ o), axis=1), _Fit(W, o, order, None)


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
