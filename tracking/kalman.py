"""A Kalman filter on position and its derivatives, for measurements at any stamps (R, "Kalman filter")."""

from dataclasses import dataclass, replace
from functools import cache
from math import factorial

import numpy as np

from pps_vision.types import Array

_REFERENCE_M = 0.4  # where peripersonal space is learned; the defaults are meant for there


@dataclass(frozen=True)
class KalmanParams:
    """`order` 1–4: how many of position, velocity, acceleration, jerk are modelled (R: 4).

    `noise_density` is the spectral density of the white noise that drives the derivative above the
    highest modelled one, (m/s^order)²·s; `prior_std` the spread of each derivative before it was
    observed (position excepted: the first measurement gives it), m/s, m/s², m/s³; `gate_chi2` the
    squared Mahalanobis distance (3 degrees of freedom) above which a measurement is an outlier;
    after `max_rejections` outliers in a row the filter starts again from the newest.
    """

    order: int = 4
    noise_density: float = 100.0
    prior_std: tuple[float, float, float] = (0.3, 0.5, 2.0)
    gate_chi2: float = 20.0
    max_rejections: int = 3

    def __post_init__(self) -> None:
        if self.order not in (1, 2, 3, 4):
            raise ValueError(f"filter order {self.order}; expected 1, 2, 3 or 4")
        if not (self.noise_density > 0 and self.gate_chi2 > 0 and self.max_rejections >= 1):
            raise ValueError(
                f"noise density {self.noise_density}, gate {self.gate_chi2}, rejections {self.max_rejections}: "
                "expected positive numbers"
            )


def scaled(params: KalmanParams, distance_m: float) -> KalmanParams:
    """The same filter for an object at another distance: what is far away (or given in another unit)
    moves and changes as fast in the image, so its lengths grow with the distance; 0.4 m is 1."""
    scale = distance_m / _REFERENCE_M
    std = tuple(scale * value for value in params.prior_std)
    return replace(params, noise_density=params.noise_density * scale**2, prior_std=(std[0], std[1], std[2]))


@dataclass(frozen=True, slots=True)
class Belief:
    """`mean` (order, 3) and `cov` (3·order, 3·order) of the state at `stamp_s`; when it was last
    updated; `rejections` so far in a row; `nis` the last innovation's squared Mahalanobis distance
    (expected 3), NaN before the first."""

    stamp_s: float
    mean: Array
    cov: Array
    updated_s: float
    rejections: int = 0
    nis: float = float("nan")


@cache
def _powers(order: int) -> tuple[Array, Array, Array, Array]:
    """Exponents of dt and denominators of the transition, then of the process noise."""
    i, j = np.mgrid[:order, :order]
    n = order - 1
    fact = np.array([factorial(k) for k in range(order)], dtype=float)
    ahead = np.maximum(j - i, 0)
    scale = np.where(j >= i, 1 / fact[ahead], 0.0)
    power = 2 * n + 1 - i - j
    return ahead.astype(float), scale, power.astype(float), 1 / (power * fact[n - i] * fact[n - j])


def transition(order: int, dt_s: float) -> Array:
    """(order, order) A_ij = dt^(j−i)/(j−i)! (FACTS §4)."""
    exponent, scale, _, _ = _powers(order)
    A: Array = scale * dt_s**exponent
    return A


def process_noise(order: int, dt_s: float, density: float) -> Array:
    """(order, order) covariance that white noise of the next derivative leaves after `dt_s`."""
    _, _, exponent, scale = _powers(order)
    Q: Array = density * scale * dt_s**exponent
    return Q


def start(params: KalmanParams, stamp_s: float, position: Array, cov: Array) -> Belief:
    """The belief after the first measurement: `position` (3,) m with `cov` (3, 3) m²."""
    mean = np.zeros((params.order, 3))
    mean[0] = position
    prior = np.array([0.0, *params.prior_std[: params.order - 1]])
    P = np.kron(np.diag(prior**2), np.eye(3))
    P[:3, :3] = cov
    return Belief(stamp_s, mean, P, stamp_s)


def predict(params: KalmanParams, belief: Belief, stamp_s: float) -> Belief:
    """The belief at a later stamp; ValueError for an earlier one."""
    dt = stamp_s - belief.stamp_s
    if not dt >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    if dt == 0:
        return belief
    n = params.order
    A = transition(n, dt)
    half = (A @ belief.cov.reshape(n, -1)).reshape(3 * n, 3 * n)  # A ⊗ I from the left …
    P = (A @ half.T.reshape(n, -1)).reshape(3 * n, 3 * n)  # … and from the right
    per_axis = P.reshape(n, 3, n, 3)
    for axis in range(3):
        per_axis[:, axis, :, axis] += process_noise(n, dt, params.noise_density)
    return replace(belief, stamp_s=stamp_s, mean=A @ belief.mean, cov=_symmetric(P))


def update(params: KalmanParams, belief: Belief, position: Array, cov: Array) -> Belief:
    """The belief after a measured `position` (3,) m with `cov` (3, 3) m² at its stamp.

    A measurement outside the gate is first taken for a sudden change of motion (everything but the
    position as uncertain as at the start); outside that too it is an outlier, which leaves the state
    as it was and counts.  The one after too many restarts the filter.
    """
    nis = _nis(belief, position, cov)
    if nis > params.gate_chi2:
        loose = _loosened(params, belief)
        if _nis(loose, position, cov) > params.gate_chi2:
            if belief.rejections + 1 >= params.max_rejections:
                return start(params, belief.stamp_s, position, cov)
            return replace(belief, rejections=belief.rejections + 1, nis=nis)
        belief = loose
    S = belief.cov[:3, :3] + cov
    gain = np.linalg.solve(S, belief.cov[:3]).T
    mean = belief.mean + (gain @ (position - belief.mean[0])).reshape(params.order, 3)
    keep = np.eye(3 * params.order)
    keep[:, :3] -= gain
    P = keep @ belief.cov @ keep.T + gain @ cov @ gain.T  # Joseph form: positive whatever the rounding
    return Belief(belief.stamp_s, mean, _symmetric(P), belief.stamp_s, 0, nis)


def _nis(belief: Belief, position: Array, cov: Array) -> float:
    """Squared Mahalanobis distance of a measurement from where it was expected."""
    innovation = position - belief.mean[0]
    return float(innovation @ np.linalg.solve(belief.cov[:3, :3] + cov, innovation))


def _loosened(params: KalmanParams, belief: Belief) -> Belief:
    """As if the motion had begun anew at the last update: its prior spread added to every derivative."""
    prior = np.diag([0.0, *params.prior_std[: params.order - 1]]) ** 2
    A = transition(params.order, belief.stamp_s - belief.updated_s)
    return replace(belief, cov=belief.cov + np.kron(A @ prior @ A.T, np.eye(3)))


def _symmetric(P: Array) -> Array:
    half: Array = 0.5 * (P + P.T)
    return half
