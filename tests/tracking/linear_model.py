"""The filter's motion model by matrix exponentials, and a Kalman filter on it, as textbooks write both."""

import numpy as np
from scipy.linalg import expm

from tracking.kalman import KalmanParams

Decay = tuple[float, float]


def system(order: int, decay_s: Decay) -> np.ndarray:
    """A of ẋ = A x + G w; with r, s = 1/decay_s, order 3: ȧ = −r a + w, 4: (d/dt + r)(d/dt + s) a = w."""
    r = 1 / decay_s[0]
    s = 1 / decay_s[1]
    A = np.eye(order, k=1)
    if order == 3:
        A[2, 2] = -r
    if order == 4:
        A[3, 2:] = -r * s, -(r + s)
    return A


def discretised(order: int, dt_s: float, decay_s: Decay) -> tuple[np.ndarray, np.ndarray]:
    """F and Q (order, order) for unit density by Van Loan (1978), from one exponential of twice the size."""
    unit = dt_s ** -np.arange(order, dtype=float)  # scales the derivatives to limit rounding errors
    A = dt_s * system(order, decay_s) * np.outer(1 / unit, unit)
    G = np.zeros((order, order))
    G[-1, -1] = 1
    whole = expm(np.block([[-A, G], [np.zeros_like(A), A.T]]))
    F = whole[order:, order:].T
    return F * np.outer(unit, 1 / unit), F @ whole[:order, order:] * np.outer(unit, unit) * dt_s / unit[-1] ** 2


def matrices(params: KalmanParams, dt_s: float, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """F and Q (3·order, 3·order) of a filter's parameters, with `scale` times its process noise."""
    F, Q = discretised(params.order, dt_s, params.decay_s)
    return np.kron(F, np.eye(3)), np.kron(scale * params.noise_density * Q, np.eye(3))


def corrected(x: np.ndarray, P: np.ndarray, z: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, covariance and squared Mahalanobis distance: K = P Hᵀ S⁻¹, x + K ν, P − K H P."""
    S = P[:3, :3] + R
    nu = z - x[:3]
    K = P[:, :3] @ np.linalg.inv(S)
    return x + K @ nu, P - K @ P[:3], float(nu @ np.linalg.solve(S, nu))
