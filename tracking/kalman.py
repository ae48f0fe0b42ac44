"""A Kalman filter on position and its derivatives, for measurements at any stamps (R, "Kalman filter")."""

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from math import factorial

import numpy as np

from pps_vision.types import Array

_REFERENCE_M = 0.4  # where peripersonal space is learned; the defaults are meant for there
_TICK_S = 1e-6  # steps are told apart no finer, so that regular frames share their matrices
_UNREST = (0.1, 3.0)  # straight at constant speed; the sharpest turns of what a hand moves
# By order, on rendered balls and markers at 5–15 cm/s (bench filter): innovations as large as expected.
NOISE_DENSITY = {1: 2e-4, 2: 1.5e-3, 3: 0.1, 4: 30.0}


@dataclass(frozen=True)
class KalmanParams:
    """`order` 1–4: how many of position, velocity, acceleration, jerk are modelled (R: 4).

    `noise_density` is the spectral density of the white noise that drives the derivative above the
    highest modelled one, (m/s^order)²·s, when the filter begins and where the motion jumps; from there it follows the
    innovations at `unrest_rate` (a quiet motion is predicted the better the quieter it is taken for; 0: it stays);
    `prior_std` the spread of each derivative before it was
    observed (position excepted: the first measurement gives it), m/s, m/s², m/s³.  Of a measurement's
    covariance only `white_share` is new with every frame; the rest (shape, light, head pose) stays from
    frame to frame, so no filtering averages it out.  `gate_chi2` is the squared Mahalanobis distance
    (3 degrees of freedom) above which a measurement is an outlier; after `max_rejections` outliers
    in a row the filter starts again from the newest.
    """

    order: int = 3
    noise_density: float = NOISE_DENSITY[3]
    prior_std: tuple[float, float, float] = (0.3, 0.5, 2.0)
    white_share: float = 0.4
    unrest_rate: float = 0.2
    gate_chi2: float = 14.0
    max_rejections: int = 3

    def __post_init__(self) -> None:
        if self.order not in NOISE_DENSITY:
            raise ValueError(f"filter order {self.order}; expected 1, 2, 3 or 4")
        if not (self.noise_density > 0 and self.gate_chi2 > 0 and self.max_rejections >= 1):
            raise ValueError(
                f"noise density {self.noise_density}, gate {self.gate_chi2}, rejections {self.max_rejections}: "
                "expected positive numbers"
            )
        if not 0 < self.white_share <= 1:
            raise ValueError(f"white share {self.white_share}; expected more than 0 and at most 1")
        if not 0 <= self.unrest_rate <= 1:
            raise ValueError(f"unrest rate {self.unrest_rate}; expected 0 to 1")

    @classmethod
    def of_order(cls, order: int) -> "KalmanParams":
        """The defaults of an order, each with the noise density measured for it; ValueError for another."""
        return cls(order, NOISE_DENSITY.get(order, 1.0))


def scaled(params: KalmanParams, distance_m: float) -> KalmanParams:
    """The same filter for an object at another distance: what is far away (or given in another unit)
    moves and changes as fast in the image, so its lengths grow with the distance; 0.4 m is 1."""
    scale = distance_m / _REFERENCE_M
    std = tuple(scale * value for value in params.prior_std)
    return replace(params, noise_density=params.noise_density * scale**2, prior_std=(std[0], std[1], std[2]))


@dataclass(frozen=True, slots=True)
class Belief:
    """`mean` (order, 3) and `cov` (3·order, 3·order) of the state at `stamp_s`, but for the error `lasting`
    (3, 3) m² of the position that the measurements share; when it was last updated; `rejections` so far in
    a row; `nis` the last innovation's squared Mahalanobis distance (expected 3), NaN before the first; `unrest` how
    much denser the process noise is than the parameters' own."""

    stamp_s: float
    mean: Array
    cov: Array
    lasting: Array
    updated_s: float
    rejections: int = 0
    nis: float = float("nan")
    unrest: float = 1.0


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


@lru_cache(maxsize=256)
def _step(order: int, ticks: int) -> tuple[Array, Array, Array]:
    """A of one axis, A and Q (for a density of 1) of all three."""
    A, eye = transition(order, ticks * _TICK_S), np.eye(3)
    return A, np.kron(A, eye), np.kron(process_noise(order, ticks * _TICK_S, 1.0), eye)


def start(params: KalmanParams, stamp_s: float, position: Array, cov: Array) -> Belief:
    """The belief after the first measurement: `position` (3,) m with `cov` (3, 3) m²."""
    mean = np.zeros((params.order, 3))
    mean[0] = position
    prior = np.array([0.0, *params.prior_std[: params.order - 1]])
    P = np.kron(np.diag(prior**2), np.eye(3))
    P[:3, :3] = params.white_share * cov
    return Belief(stamp_s, mean, P, (1 - params.white_share) * cov, stamp_s)


def predict(params: KalmanParams, belief: Belief, stamp_s: float) -> Belief:
    """The belief at a later stamp; ValueError for an earlier one."""
    return forecast(params, belief, stamp_s)[0]


def forecast(params: KalmanParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The same, and the covariance (3·order, 3·order) of the state now with the state then (for smoothing)."""
    dt = stamp_s - belief.stamp_s
    if not dt >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    if dt == 0:
        return belief, belief.cov
    A, A3, Q3 = _step(params.order, round(dt / _TICK_S))
    cross = belief.cov @ A3.T
    P = A3 @ cross + belief.unrest * params.noise_density * Q3
    b = belief
    return Belief(stamp_s, A @ b.mean, P, b.lasting, b.updated_s, b.rejections, b.nis, b.unrest), cross


def update(params: KalmanParams, belief: Belief, position: Array, cov: Array) -> Belief:
    """The belief after a measured `position` (3,) m with `cov` (3, 3) m² at its stamp.

    A measurement outside the gate is first taken for a sudden change of motion (everything but the
    position as uncertain as at the start); outside that too it is an outlier, which leaves the state
    as it was and counts.  The one after too many restarts the filter.
    """
    admitted = admit(params, belief, position, cov)
    if admitted is None:
        if belief.rejections + 1 >= params.max_rejections:
            return start(params, belief.stamp_s, position, cov)
        return replace(belief, rejections=belief.rejections + 1)
    return correct(params, admitted, cov)


@dataclass(frozen=True, slots=True)
class Admitted:
    """A measurement that fits a belief: the belief it fits, squared Mahalanobis distance and difference
    (3,) from what was expected, and the inverse (3, 3) of the difference's covariance."""

    belief: Belief
    nis: float
    innovation: Array
    weight: Array


def admit(params: KalmanParams, belief: Belief, position: Array, cov: Array) -> Admitted | None:
    """The measurement beside the belief it fits, as it is or loosened; None for an outlier."""
    white = params.white_share * cov
    admitted = _compared(belief, position, white)
    if admitted.nis > params.gate_chi2:
        admitted = _compared(_loosened(params, belief), position, white)
    return admitted if admitted.nis <= params.gate_chi2 else None


def correct(params: KalmanParams, admitted: Admitted, cov: Array) -> Belief:
    """The belief after an admitted measurement of covariance `cov` (3, 3) m²."""
    before = admitted.belief
    gain = before.cov[:, :3] @ admitted.weight
    mean = before.mean + (gain @ admitted.innovation).reshape(params.order, 3)
    P = before.cov - gain @ before.cov[:3]
    P = 0.5 * (P + P.T)  # rounding must not add up
    lasting, unrest = (1 - params.white_share) * cov, _unrest(params, before.unrest, admitted.nis)
    return Belief(before.stamp_s, mean, P, lasting, before.stamp_s, 0, admitted.nis, unrest)


def _unrest(params: KalmanParams, before: float, nis: float) -> float:
    """Up where innovations are larger than expected, down where they are smaller."""
    return min(max(before * math.exp(params.unrest_rate * (nis / 3 - 1)), _UNREST[0]), _UNREST[1])


def _compared(belief: Belief, position: Array, white: Array) -> Admitted:
    innovation = position - belief.mean[0]
    weight = _inverse(belief.cov[:3, :3] + white)
    return Admitted(belief, float(innovation @ weight @ innovation), innovation, weight)


def _inverse(S: Array) -> Array:
    """Of a symmetric (3, 3) matrix by its adjugate: plain floats take half the time of a call to LAPACK."""
    (a, b, c), (_, d, e), (_, _, f) = S.tolist()
    A, B, C, D, E, F = d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * A + b * B + c * C
    return np.array(((A, B, C), (B, D, E), (C, E, F))) / determinant


def _loosened(params: KalmanParams, belief: Belief) -> Belief:
    """As if the motion had begun anew at the last update: its prior spread added to every derivative, and as
    much unrest as at the start."""
    prior = np.diag([0.0, *params.prior_std[: params.order - 1]]) ** 2
    A = transition(params.order, belief.stamp_s - belief.updated_s)
    cov = belief.cov + np.kron(A @ prior @ A.T, np.eye(3))
    return replace(belief, cov=cov, unrest=max(belief.unrest, 1.0))
