"""A Kalman filter on position and its derivatives, for measurements at any stamps (R, "Kalman filter")."""

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from math import factorial
from typing import NamedTuple

import numpy as np

from pps_vision.types import Array

_REFERENCE_M = 0.4  # where peripersonal space is learned; the defaults are meant for there
_TICK_S = 1e-6  # steps are told apart no finer, so that regular frames share their matrices
_UNREST = (0.025, 3.0)  # straight at constant speed; the sharpest turns of what a hand moves
# By order, on rendered balls and markers at 5–15 cm/s (bench filter): innovations as large as expected.
NOISE_DENSITY = {1: 2e-4, 2: 1.5e-3, 3: 0.2, 4: 30.0}


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
    (3 degrees of freedom) above which a measurement is no longer taken for the motion going on, `jump_chi2` that
    above which it is no sudden change of motion either but an outlier (a hundred thousandth of those `prior_std`
    expects); after `max_rejections` outliers in a row the filter starts again from the newest.
    """

    order: int = 3
    noise_density: float = NOISE_DENSITY[3]
    prior_std: tuple[float, float, float] = (0.3, 0.5, 2.0)
    white_share: float = 0.4
    unrest_rate: float = 0.2
    gate_chi2: float = 14.0
    jump_chi2: float = 26.0
    max_rejections: int = 3

    def __post_init__(self) -> None:
        if self.order not in NOISE_DENSITY:
            raise ValueError(f"filter order {self.order}; expected 1, 2, 3 or 4")
        if not (self.noise_density > 0 and self.gate_chi2 > 0 and self.jump_chi2 > 0 and self.max_rejections >= 1):
            raise ValueError(
                f"noise density {self.noise_density}, gate {self.gate_chi2}, gate of jumps {self.jump_chi2}, "
                f"rejections {self.max_rejections}: expected positive numbers"
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


class Belief(NamedTuple):  # two are made every frame: a frozen dataclass takes thrice as long
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
def _step(order: int, ticks: int, density: float) -> tuple[Array, Array, Array, Array]:
    """A of one axis; A, half its transpose and Q of all three."""
    A, eye = transition(order, ticks * _TICK_S), np.eye(3)
    A3 = np.kron(A, eye)
    return A, A3, 0.5 * A3.T, np.kron(process_noise(order, ticks * _TICK_S, density), eye)


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
    return _ahead(params, belief, stamp_s)[0]


def forecast(params: KalmanParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The same, and the covariance (3·order, 3·order) of the state now with the state then (for smoothing)."""
    ahead, half = _ahead(params, belief, stamp_s)
    return ahead, 2 * half


def _ahead(params: KalmanParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The belief at a later stamp, and half of the covariance of the state now with the state then."""
    dt = stamp_s - belief.stamp_s
    if not dt >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    if dt == 0:
        return belief, 0.5 * belief.cov
    A, A3, half_A3T, Q3 = _step(params.order, round(dt / _TICK_S), params.noise_density)
    half = belief.cov.dot(half_A3T)
    P = A3.dot(half)
    P = P + P.T  # symmetric to the last bit: rounding must not add up
    P += belief.unrest * Q3
    b = belief
    return Belief(stamp_s, A.dot(b.mean), P, b.lasting, b.updated_s, b.rejections, b.nis, b.unrest), half


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
        return belief._replace(rejections=belief.rejections + 1)
    return correct(params, admitted, cov)


class Admitted(NamedTuple):
    """A measurement that fits a belief: the belief it fits, squared Mahalanobis distance of the difference ν from
    what was expected, and (4, 3) what to multiply the covariance's first three rows with: L⁻¹, and below it
    ν weighed by its covariance L Lᵀ."""

    belief: Belief
    nis: float
    weights: Array


def admit(params: KalmanParams, belief: Belief, position: Array, cov: Array) -> Admitted | None:
    """The measurement beside the belief it fits, as it is or loosened; None for an outlier."""
    admitted = _compared(params, belief, position, cov)
    if admitted.nis <= params.gate_chi2:
        return admitted
    admitted = _compared(params, _loosened(params, belief), position, cov)
    return admitted if admitted.nis <= params.jump_chi2 else None


def correct(params: KalmanParams, admitted: Admitted, cov: Array) -> Belief:
    """The belief after an admitted measurement of covariance `cov` (3, 3) m²."""
    before = admitted.belief
    gain = admitted.weights.dot(before.cov[:3])
    mean = before.mean + gain[3].reshape(before.mean.shape)
    taken = gain[:3]
    P = before.cov - taken.T.dot(taken)  # as symmetric as before
    lasting, unrest = (1 - params.white_share) * cov, _unrest(params, before.unrest, admitted.nis)
    return Belief(before.stamp_s, mean, P, lasting, before.stamp_s, 0, admitted.nis, unrest)


def _unrest(params: KalmanParams, before: float, nis: float) -> float:
    """Up where innovations are larger than expected, down where they are smaller."""
    return min(max(before * math.exp(params.unrest_rate * (nis / 3 - 1)), _UNREST[0]), _UNREST[1])


def _compared(params: KalmanParams, belief: Belief, position: Array, cov: Array) -> Admitted:
    """L is Cholesky's; plain floats take a fraction of the time of calls on arrays this small."""
    w = params.white_share
    (a, b, c), (_, d, e), (_, _, f) = belief.cov[:3, :3].tolist()
    (ra, rb, rc), (_, rd, re), (_, _, rf) = cov.tolist()
    (x, y, z), (mx, my, mz) = position.tolist(), belief.mean[0].tolist()
    i = 1 / math.sqrt(a + w * ra)
    bi, ci = (b + w * rb) * i, (c + w * rc) * i
    j = 1 / math.sqrt(d + w * rd - bi * bi)
    ej = (e + w * re - bi * ci) * j
    k = 1 / math.sqrt(f + w * rf - ci * ci - ej * ej)
    ij, jk = -bi * i * j, -ej * j * k
    ik = -(ci * i + ej * ij) * k
    x, y, z = x - mx, y - my, z - mz
    x, y, z = i * x, ij * x + j * y, ik * x + jk * y + k * z
    weighed = (i * x + ij * y + ik * z, j * y + jk * z, k * z)
    return Admitted(belief, x * x + y * y + z * z, np.array(((i, 0.0, 0.0), (ij, j, 0.0), (ik, jk, k), weighed)))


def _loosened(params: KalmanParams, belief: Belief) -> Belief:
    """As if the motion had begun anew at the last update: its prior spread added to every derivative, and as
    much unrest as at the start."""
    prior = np.diag([0.0, *params.prior_std[: params.order - 1]]) ** 2
    A = transition(params.order, belief.stamp_s - belief.updated_s)
    cov = belief.cov + np.kron(A @ prior @ A.T, np.eye(3))
    return belief._replace(cov=cov, unrest=max(belief.unrest, 1.0))
