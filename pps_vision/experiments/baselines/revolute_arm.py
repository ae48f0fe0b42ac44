"""Forward model arm posture → gaze posture for revolute joints, exact from a hundred samples of an exact robot.

The position of the hand is linear in the products Φ of 1, cos q and sin q of the joint angles.  The eyes see it from a
head that the neck carries: the lines of sight cross there but for C(gaze) o, where o holds the constant offsets between
eyes and neck.  So Φ(arm) W = crossing(gaze) + C(gaze) o is linear in the unknown W and o, which gives a first estimate;
the noise is in the gaze, so that both are then fitted in its angles.  Outliers (another point fixated, an encoder
stuck) get little weight.  A neck that yaws first is the same with yaw and pitch exchanged.  The residual of such a
robot is left to a process, as in `learning/reach/forward_model.py`.
"""

from typing import NamedTuple

import numpy as np

from learning.reach.forward_model import EYES_APART_M, NO_ERROR, RevoluteModel, bases_of, products
from learning.reach.residual import fit_residual
from pps_vision.experiments.babbling import crossing, gaze_at
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.types import Array

_LINEAR_ROUNDS = 20  # iterations of each kind until they converge
_FIXED_ROUNDS = 10
_FREE_ROUNDS = 4
_WIDE = GazeLimits((-1.5, 1.5), (-1.5, 1.5), (0.01, 2.5))
_FINE = IKParams(tolerance=1e-9, max_steps=30)
_ORDERS = ((0, 1, 2), (1, 0, 2))  # of yaw, pitch, vergence: a neck that pitches first (the iCub's), or yaws first
_SURE = 5.0  # standard deviations by which more than half of the samples must fit the second order better
_NEGLIGIBLE_RAD = 1e-5  # a median residual of 0.0006° needs no process


class _FittedArm(NamedTuple):
    """W and the process that is added to Φ W, o (4,), and the order of the neck's joints."""

    model: RevoluteModel
    o: Array
    order: tuple[int, ...]


class RevoluteArm:
    """Learns the position of the hand from arm postures (N, k) in rad and the gaze postures (N, 3) that fixate it.

    Positions are seen from the neck and measured in eye distances; `EYES_APART_M` scales them to metres.  `corrected`:
    with the process, where there is evidence for it."""

    def __init__(self, corrected: bool = True) -> None:
        self.corrected = corrected
        self._samples: list[tuple[Array, Array]] = []
        self._fitted: _FittedArm | None = None

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """Add samples in the order of their measurement, of which blocks are the evidence for the process."""
        self._samples.append((arm_rad, gaze_rad))
        self._fitted = None

    def _fit(self) -> _FittedArm:
        """The model of all samples, fitted at its first use; ValueError before the second sample."""
        if self._fitted is None:
            n = sum(len(arm) for arm, _ in self._samples)
            if n < 2:
                raise ValueError(f"{n} samples: expected at least two to learn from")
            arm, gaze = (np.concatenate(parts) for parts in zip(*self._samples, strict=True))
            A = products(bases_of(arm))
            structures = [_structure(A, gaze, order) for order in _ORDERS]
            second_is_better = structures[1][0] < structures[0][0]
            off, fitted = structures[bool(2 * np.mean(second_is_better) - 1 > _SURE / np.sqrt(n))]
            if self.corrected and np.median(off) > _NEGLIGIBLE_RAD:
                W = fitted.model.W
                place, slope = _fixated(gaze[:, fitted.order], fitted.o)
                residual = fit_residual(arm, place - A @ W, np.linalg.inv(slope))
                fitted = fitted._replace(model=RevoluteModel(W, residual))
            self._fitted = fitted
        return self._fitted

    def forward(self, arm_rad: Array) -> tuple[Array, Array]:
        """Positions of the hand (N, 3) m, and their Jacobians by the joints (N, 3, k)."""
        return self._fit().model.forward(arm_rad)

    def points(self, gaze_rad: Array) -> Array:
        """(N, 3) m: the points that gaze postures (N, 3) fixate."""
        fitted = self._fit()
        gaze = gaze_rad[:, fitted.order]
        return EYES_APART_M * (crossing(gaze) + _carried(gaze) @ fitted.o)

    def gaze(self, points: Array, limits: GazeLimits = _WIDE) -> Array:
        """(N, 3) rad: the gaze postures that fixate points (N, 3); NaN where the limits forbid it."""
        fitted = self._fit()

        def forward(gaze: Array) -> tuple[Array, Array]:
            place, slope = _fixated(gaze, fitted.o)
            return EYES_APART_M * place, EYES_APART_M * slope

        lower, upper = (ends[list(fitted.order)] for ends in (limits.lower, limits.upper))
        starts = np.clip(gaze_at(points / EYES_APART_M), lower, upper)[None]
        solution = solve_ik(forward, points, starts, lower, upper, _FINE)
        gaze = solution.q_rad[:, fitted.order]  # each order is its own inverse
        return np.where(solution.converged[:, None], gaze, np.nan)

    def __call__(self, arm_rad: Array) -> Array:
        """Gaze postures (N, 3) for arm postures (N, k)."""
        return self.gaze(self.forward(arm_rad)[0])


def _structure(A: Array, gaze: Array, order: tuple[int, ...]) -> tuple[Array, _FittedArm]:
    """The residuals (N,) rad of the robot with one order of the neck's joints, and the robot.

    First the least sum of distances, by iteratively reweighted least squares, on which outliers have little
    influence; then Gauss–Newton steps in the angles of the gaze with Geman–McClure weights.  Both estimate
    the noise variance from the median residual.  Both have the prior W, o ~ N(0, 1) in eye distances: 0.5 to 2 measured
    on 20 simulated arms with other end points."""
    gaze = gaze[:, order]
    Z = np.concatenate([crossing(gaze)[:, :, None], _carried(gaze)], axis=2)
    weight = np.ones(len(A))
    spread = np.median(np.linalg.norm(Z[:, :, 0] - np.median(Z[:, :, 0], axis=0), axis=1))
    noise = spread**2 / 3  # variance of a coordinate before the first estimate
    for _ in range(_LINEAR_ROUNDS):
        W, o = _least_squares(A, Z, weight, noise)
        off = np.linalg.norm(Z[:, :, 0] + Z[:, :, 1:] @ o - A @ W, axis=1)
        middle = np.median(off) + NO_ERROR
        weight = 1 / np.maximum(off, 0.1 * middle)
        noise = middle / 3  # the variance times the weight
    predicted = gaze
    for k in range(_FIXED_ROUNDS + _FREE_ROUNDS):
        W, o, predicted = _gauss_newton(A, gaze, W, o, predicted, moves=k >= _FIXED_ROUNDS)
    off = np.linalg.norm(gaze - gaze_at(A @ W - _carried(predicted) @ o), axis=1)
    return off, _FittedArm(RevoluteModel(W, None), o, order)


def _least_squares(A: Array, Z: Array, weight: Array, prior: float) -> tuple[Array, Array]:
    """W (m, 3) and o (4,) of the least Σ weight |A W − Z (1, o)|² + prior (|W|² + |o|²): A (N, m), Z (N, 3, 5)."""
    m = A.shape[1]
    weighted = Z * weight[:, None, None]
    AZ = np.tensordot(A, weighted, axes=(0, 0))
    X = np.linalg.solve((A * weight[:, None]).T @ A + prior * np.eye(m), AZ.reshape(m, -1)).reshape(AZ.shape)
    schur = np.tensordot(Z, weighted, axes=((0, 1), (0, 1))) - np.tensordot(AZ, X, axes=((0, 1), (0, 1)))
    o = -np.linalg.solve(schur[1:, 1:] + prior * np.eye(4), schur[1:, 0])
    return X @ np.append(1.0, o), o


def _gauss_newton(A: Array, gaze: Array, W: Array, o: Array, predicted: Array, moves: bool) -> tuple[Array, ...]:
    """One Gauss–Newton step of W (m, 3) and o (4,) towards the observed gaze postures (N, 3).

    Linearised about `predicted` (N, 3), the gaze by the previous W and o; returned updated.  The head stays at
    `predicted`, which converges from far, or `moves` with it, which converges faster."""
    carried = _carried(predicted)
    predicted = gaze_at(A @ W - carried @ o)
    place, slope = _fixated(predicted, o if moves else np.zeros(4))
    G = np.linalg.inv(slope)  # ∂gaze/∂place
    if moves:
        nearer = predicted + (G @ (A @ W - place)[..., None])[..., 0]
        predicted = np.clip(nearer, _WIDE.lower, _WIDE.upper)
        carried = _carried(predicted)
    off = np.linalg.norm(gaze - predicted, axis=1)
    middle = np.median(off) + NO_ERROR
    weight = 1 / (1 + (off / (4 * middle)) ** 2)  # its square weighs the squares
    H = np.concatenate([(A[:, None, :, None] * G[:, :, None]).reshape(len(A), 3, -1), -G @ carried], axis=2)
    H = (H * weight[:, None, None]).reshape(-1, H.shape[2])
    residual = ((gaze - predicted) * weight[:, None]).ravel()
    unknowns = np.append(W.ravel(), o)
    prior = middle**2 / 3  # noise variance over the prior's, 1
    step = np.linalg.solve(H.T @ H + prior * np.eye(len(unknowns)), H.T @ residual - prior * unknowns)
    unknowns = unknowns + step
    return unknowns[:-4].reshape(W.shape), unknowns[-4:], predicted


def _fixated(gaze_rad: Array, o: Array) -> tuple[Array, Array]:
    """Points (N, 3) that gaze postures (N, 3) fixate, in eye distances, and their Jacobians (N, 3, 3)."""
    h = 1e-7
    gaze = np.concatenate([gaze_rad, *(gaze_rad + h * axis for axis in np.eye(3))])
    point, *moved = (crossing(gaze) + _carried(gaze) @ o).reshape(4, -1, 3)
    return point, (np.stack(moved, axis=2) - point[:, :, None]) / h


def _carried(gaze_rad: Array) -> Array:
    """(N, 3, 4) C: unit vectors ahead of the face, to its right and up, and ahead of the neck after its pitch."""
    yaw, pitch, _ = gaze_rad.T
    cy, cp = np.cos([yaw, pitch])
    sy, sp = np.sin([yaw, pitch])
    zero = np.zeros(len(yaw))
    axes = [(sy, cy * sp, cy * cp), (cy, -sy * sp, -sy * cp), (zero, cp, -sp), (zero, sp, cp)]
    return np.stack([np.stack(axis, axis=1) for axis in axes], axis=2)
