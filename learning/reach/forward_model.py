"""Forward model of a hand that revolute joints move: where it is off the robot's own model, by where the eyes saw it.

The position of the hand is linear in the products Φ of 1, cos q and sin q of the joint angles.  The residual of such a
robot (sag, errors of gears, cross-talk) is left to a Gaussian process of the arm posture, `learning/reach/residual.py`.
"""

from dataclasses import dataclass

import numpy as np

from learning.reach.residual import Residual, fit_residual
from pps_vision.types import Array

N_JOINTS = 4  # the arm's (J)
EYES_APART_M = 0.068
NO_ERROR = 1e-9  # residuals below this count as this
_ROUNDS = 10  # iterations until they converge
# Prior error of a hand's place by a robot's own model.  Less than R's several centimetres: images in a row share the
# joints' errors and count as more evidence than they are, so that a wider prior goes astray where no hand was seen.
_MODEL_ERROR_M = 0.01


@dataclass(frozen=True)
class RevoluteModel:
    """Positions (N, 3) of the hand at arm postures (N, k): Φ W, and a process of the posture where there is evidence
    for it, in eye distances."""

    W: Array  # (3^k, 3)
    residual: Residual | None

    @classmethod
    def of_offsets(cls, arm_rad: Array, offsets: Array, covs: Array) -> "RevoluteModel":
        """The offsets (N, 3) m of the hand at arm postures (N, k) from where a model of the arm has it, measured with
        covariances (N, 3, 3).  Prior: an offset is N(0, `_MODEL_ERROR_M`²), also where the hand is never seen.
        Outliers get little weight (Geman–McClure)."""
        A = products(bases_of(arm_rad))
        G = EYES_APART_M * np.linalg.inv(np.linalg.cholesky(covs))  # eye distances to standard deviations
        place = offsets / EYES_APART_M
        precision = np.prod([2.0] * N_JOINTS) * (EYES_APART_M / _MODEL_ERROR_M) ** 2  # |Φ|² = 2^k at every posture
        weight = np.ones(len(A))
        middle = 1.0
        for _ in range(_ROUNDS):
            weighted = weight[:, None, None] * G
            H = (weighted[:, :, None, :] * A[:, None, :, None]).reshape(3 * len(A), -1)
            normal = H.T @ H + middle**2 / 3 * precision * np.eye(H.shape[1])
            W = np.linalg.solve(normal, H.T @ (weighted @ place[..., None]).ravel()).reshape(-1, 3)
            off = np.linalg.norm((G @ (place - A @ W)[..., None])[..., 0], axis=1)
            middle = np.median(off) + NO_ERROR
            weight = 1 / (1 + (off / (4 * middle)) ** 2)
        return cls(W, fit_residual(arm_rad, place - A @ W, G))

    def forward(self, arm_rad: Array) -> tuple[Array, Array]:
        """Positions of the hand (N, 3) m, and their Jacobians by the joints (N, 3, k)."""
        bases = bases_of(arm_rad)
        slopes = [np.stack([0 * b[:, 0], -b[:, 2], b[:, 1]], axis=1) for b in bases]
        half = N_JOINTS // 2
        W = (EYES_APART_M * self.W).reshape(3**half, -1)

        def place(first: Array, second: Array) -> Array:
            return np.asarray((second[:, None] @ (first @ W).reshape(len(first), -1, 3))[:, 0])

        first = products(bases[:half])
        second = products(bases[half:])
        columns = []
        for k in range(N_JOINTS):
            turned = [*bases[:k], slopes[k], *bases[k + 1 :]]
            halves = (products(turned[:half]), second) if k < half else (first, products(turned[half:]))
            columns.append(place(*halves))
        position = place(first, second)
        J = np.stack(columns, axis=2)
        if self.residual is None:
            return position, J
        value, slope = self.residual(arm_rad)
        return position + EYES_APART_M * value, J + EYES_APART_M * slope


def bases_of(arm_rad: Array) -> list[Array]:
    """(N, 3) of each joint: 1, cos, sin."""
    if arm_rad.ndim != 2 or arm_rad.shape[1] != N_JOINTS:
        raise ValueError(f"arm postures of shape {arm_rad.shape}: expected (N, {N_JOINTS})")
    return [np.stack([np.ones_like(q), np.cos(q), np.sin(q)], axis=1) for q in arm_rad.T]


def products(bases: list[Array]) -> Array:
    """(N, 3^k) all products of one of each (N, 3)."""
    products = bases[0]
    for basis in bases[1:]:
        products = (products[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    return products
