"""Kalman filter of order 1 to 4 on position and its derivatives, for measurements at any stamps (R, "Kalman filter").

    predict   x′ = F x                      P′ = F P Fᵀ + q Q
    gate      ν = z − H x,  S = H P Hᵀ + R  NIS = νᵀ S⁻¹ ν
    update    x + K ν                       P − K S Kᵀ,  K = P Hᵀ S⁻¹

The state x holds position, velocity, … (order, 3); H selects the position.  F and Q act on every axis.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.jit import njit
from pps_vision.types import Array, Track3D
from tracking import DEFAULT_ORDER

_REFERENCE_M = 0.4  # distance at which peripersonal space is learned; the default parameters hold there
_AT_REST_CHI2 = 11.3  # 99 % quantile with three degrees of freedom
_TERMS = 16  # number of terms in a power series
_STEADY_NOISE_SCALE = 0.025  # of straight motion at constant speed
# Smallest (0.005 and 0.012 do about as well; chosen like `stereo._TO_FIRST`); largest: back and forth once a second.
_NOISE_SCALE_RANGE = (0.008, 30.0)
# Chosen on training recordings (`bench stages`, part `filter`, seeds 8300 and 8310: 36 rendered balls and markers at
# 5–30 cm/s; every second flight of tt3d): no error of order 3 and 4 larger than without decay, coverage of velocity
# nearest to 68 and 95 %.
NOISE_DENSITY = {1: 4e-3, 2: 1.5e-3, 3: 0.2, 4: 270.0}


@dataclass(frozen=True)
class KalmanParams:
    """Parameters for an object at 0.4 m; `scaled` converts them to another distance, `of_order` to another order."""

    order: int = DEFAULT_ORDER
    """Number of modelled quantities out of position, velocity, acceleration and jerk, 1–4 (R: 4)."""
    noise_density: float = NOISE_DENSITY[DEFAULT_ORDER]
    """Spectral density q of the white noise that drives the derivative above the highest modelled one, (m/s^order)²·s,
    when the filter starts and where the motion jumps."""
    prior_std: tuple[float, float, float] = (0.3, 0.5, 2.0)
    """Prior standard deviation of velocity, acceleration and jerk, m/s, m/s², m/s³."""
    adaptation_rate: float = 0.2
    """Rate at which the process noise follows the innovations; 0 keeps it constant."""
    jump_probability: float = 0.01
    """Prior probability that the motion has turned, or jumped, since the last measurement; 0: it never does."""
    gate_chi2: float = 26.0
    """NIS above which a measurement is an outlier (1e-5 of a χ² distribution with 3 degrees of freedom)."""
    max_rejections: int = 3
    """Number of outliers in a row after which the filter restarts from the newest."""
    decay_s: tuple[float, float] = (0.4, 0.03)
    """Time constants with which acceleration and jerk decay (`discretise`); inf: no decay, as in R."""

    def __post_init__(self) -> None:
        if self.order not in NOISE_DENSITY:
            raise InputError("Kalman filter", f"filter order {self.order}; expected 1, 2, 3 or 4")
        if not (self.noise_density > 0 and self.gate_chi2 > 0 and self.max_rejections >= 1):
            raise InputError(
                "Kalman filter",
                f"noise density {self.noise_density}, gate {self.gate_chi2}, rejections {self.max_rejections}: "
                "expected positive numbers",
            )
        if not 0 <= self.jump_probability < 1:
            raise InputError("Kalman filter", f"probability of a jump {self.jump_probability}; expected 0 to 1")
        if not min(self.decay_s) > 0:
            raise InputError(
                "Kalman filter", f"acceleration and jerk decay within {self.decay_s} s; expected more than 0"
            )
        if not 0 <= self.adaptation_rate <= 1:
            raise InputError("Kalman filter", f"adaptation rate {self.adaptation_rate}; expected 0 to 1")

    @classmethod
    def of_order(cls, order: int) -> "KalmanParams":
        """Return the defaults of an order, with the process noise chosen for it; InputError unless it is 1 to 4."""
        return cls(order, NOISE_DENSITY.get(order, 1.0))


def scaled(params: KalmanParams, distance_m: float) -> KalmanParams:
    """Return the parameters for an object at another distance.

    A distant object (or one in another unit of length) moves as fast in the image, so lengths grow with the distance.
    """
    scale = distance_m / _REFERENCE_M
    velocity_std, acceleration_std, jerk_std = params.prior_std
    return replace(
        params,
        noise_density=scale**2 * params.noise_density,
        prior_std=(scale * velocity_std, scale * acceleration_std, scale * jerk_std),
    )


class Belief(NamedTuple):  # constructing a frozen dataclass is three times slower
    """State of the filter."""

    stamp_s: float  # time of the state
    mean: Array  # (order, 3) position and its derivatives
    cov: Array  # (3·order, 3·order) covariance of `mean`, without `correlated_cov`
    correlated_cov: Array  # (3, 3) m² position error that all measurements share
    updated_s: float  # time of the last update
    rejections: int = 0  # number of outliers in a row
    nis: float = math.nan  # normalised innovation squared of the last update (3 expected); NaN before the first
    noise_scale: float = 1.0  # ratio of the adapted process noise to that of the parameters


class GatedMeasurement(NamedTuple):
    """A measurement inside the gate."""

    belief: Belief  # predicted belief, inflated if the motion jumped
    innovation: Array  # (3,) ν, m
    information: Array  # (3, 3) S⁻¹, 1/m²
    nis: float  # normalised innovation squared
    correlated_cov: Array  # (3, 3) m² part of the measurement's covariance that no filtering averages out

    @property
    def cost(self) -> float:
        """−2 times its log-likelihood, up to a constant."""
        return self.nis + self.log_det

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of S."""
        return -float(np.linalg.slogdet(self.information)[1])


def start(
    params: KalmanParams,
    stamp_s: float,
    position: Array,
    cov: Array,
    correlated: Array | None = None,
) -> Belief:
    """Return the belief after the first measurement; the prior holds for all derivatives.

    Args:
        position: (3,) m.
        cov: (3, 3) m².
        correlated: (3, 3) m² part of `cov` that is known to be correlated from frame to frame; None: 0.
    """
    mean = np.zeros((params.order, 3))
    mean[0] = position
    P = np.kron(_prior(params), np.eye(3))
    white = _white(1.0, cov, correlated)
    P[:3, :3] = white
    return Belief(stamp_s, mean, P, cov - white, stamp_s)


def predict(params: KalmanParams, belief: Belief, stamp_s: float) -> Belief:
    """Return the belief at a later stamp; ValueError for an earlier one."""
    return forecast(params, belief, stamp_s)[0]


def forecast(params: KalmanParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """As `predict`, and the cross-covariance P Fᵀ of both states (3·order, 3·order), for smoothing."""
    dt_s = stamp_s - belief.stamp_s
    if not dt_s >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    density = belief.noise_scale * params.noise_density
    mean, P, cross = _propagate(belief.mean, belief.cov, dt_s, density, params.decay_s)
    return belief._replace(stamp_s=stamp_s, mean=mean, cov=P), cross


def shifted(belief: Belief, shift_cov: Array) -> Belief:
    """Return the belief if the point that is measured has moved on the object, with this covariance (3, 3) m²."""
    cov = belief.cov.copy()
    cov[:3, :3] += shift_cov
    return belief._replace(cov=cov)


def update(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None = None
) -> Belief:
    """Return the belief after a measurement at its stamp.

    A measurement outside the gate is an outlier: the state stays, and after `max_rejections` of them the filter
    restarts.

    Args:
        position: (3,) m.
        cov: (3, 3) m².
        correlated: (3, 3) m² part of `cov` that is known to be correlated from frame to frame; None: 0.
    """
    gated = gate(params, belief, position, cov, correlated)
    if gated is not None:
        return correct(params, gated)
    if belief.rejections + 1 >= params.max_rejections:
        return start(params, belief.stamp_s, position, cov, correlated=correlated)
    return belief._replace(rejections=belief.rejections + 1)


def gate(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None = None
) -> GatedMeasurement | None:
    """Gate a measurement by its NIS, for the belief or, if that is more probable, for one whose motion has turned
    or jumped.

    Arguments as for `update`; None for an outlier.
    """
    gated = compared(params, belief, position, cov, correlated)
    p = params.jump_probability
    surprise = 2 * math.log((1 - p) / p) if p > 0 else math.inf
    if gated.nis > surprise:  # else neither change is more probable
        changes = (
            compared(params, changed(params, belief), position, cov, correlated) for changed in (_turning, inflated)
        )
        likeliest = min(changes, key=lambda change: change.cost)
        gated = likeliest if likeliest.cost + surprise < gated.cost else gated
    return gated if gated.nis <= params.gate_chi2 else None


def correct(params: KalmanParams, gated: GatedMeasurement) -> Belief:
    """Return the belief after a gated measurement; the process noise follows the NIS (3 expected)."""
    belief = gated.belief
    mean, P = _condition(belief.mean, belief.cov, gated.innovation, gated.information)
    factor = math.exp(min(params.adaptation_rate * (gated.nis / 3 - 1), 100.0))  # a wide gate does not overflow
    noise_scale = min(max(factor * belief.noise_scale, _NOISE_SCALE_RANGE[0]), _NOISE_SCALE_RANGE[1])
    return Belief(belief.stamp_s, mean, P, gated.correlated_cov, belief.stamp_s, 0, gated.nis, noise_scale)


def extrapolate(params: KalmanParams, track: Track3D, dt_s: float, period_s: float = 0.0) -> tuple[Array, Array]:
    """Return the position (3,) m of a known track `dt_s` after its stamp, and its velocity half a period later.

    The motion is weighted by 1 − c/χ², with χ² the squared Mahalanobis length of the velocity and c its 99 % quantile
    for a target at rest, so that the noise of a resting target is not followed.
    """
    velocity = track.velocity
    chi2 = float(velocity @ np.linalg.solve(track.cov[3:6, 3:6] + 1e-12 * np.eye(3), velocity))
    weight = max(0.0, 1 - _AT_REST_CHI2 / chi2) if chi2 > 0 else 0.0
    order = len(track.mean)
    position = (discretise(order, dt_s, params.decay_s)[0] @ track.mean)[0]
    velocity = (discretise(order, dt_s + 0.5 * period_s, params.decay_s)[0] @ track.mean)[1]
    return track.position + weight * (position - track.position), weight * velocity


def _prior(params: KalmanParams) -> Array:
    """(order, order) prior covariance of one axis, 0 for the position."""
    return np.diag([0.0, *params.prior_std[: params.order - 1]]) ** 2


def _white(noise_scale: float, cov: Array, correlated: Array | None) -> Array:
    """(3, 3) m² of a measurement's error that is independent from frame to frame.

    It falls with the process noise where innovations are smaller than steady motion explains: the gain stays, and the
    state's covariance falls to the size of the innovations.
    """
    white: Array = min(noise_scale / _STEADY_NOISE_SCALE, 1.0) * (cov if correlated is None else cov - correlated)
    return white


def compared(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None
) -> GatedMeasurement:
    """Return the measurement with its NIS for the belief, inside the gate or not; arguments as for `update`."""
    R = _white(belief.noise_scale, cov, correlated)
    innovation, information, nis = _innovation(belief.mean, belief.cov, position, R)
    return GatedMeasurement(belief, innovation, information, nis, cov - R)


def _turning(params: KalmanParams, belief: Belief) -> Belief:
    """Return the belief if the motion has been as unsteady as it can be since the last update."""
    age_s = belief.stamp_s - belief.updated_s
    Q = discretise(params.order, age_s, params.decay_s)[1]
    added = (_NOISE_SCALE_RANGE[1] - belief.noise_scale) * params.noise_density * np.kron(Q, np.eye(3))
    return belief._replace(cov=belief.cov + added, noise_scale=max(belief.noise_scale, 1.0))


def inflated(params: KalmanParams, belief: Belief) -> Belief:
    """Return the belief if the motion jumped at any time t since the last update: P + mean of F(t) D F(t)ᵀ.

    D is the prior covariance of the derivatives, plus a reversal of the velocity, (2v)².  The mean is Simpson's rule,
    exact for order 2.
    """
    D = _prior(params)
    if params.order > 1:
        velocity = belief.mean[1]
        D[1, 1] += 4 * float(velocity @ velocity)
    age_s = belief.stamp_s - belief.updated_s
    middle = discretise(params.order, 0.5 * age_s, params.decay_s)[0]
    first = discretise(params.order, age_s, params.decay_s)[0]
    added = (first @ D @ first.T + 4 * middle @ D @ middle.T + D) / 6
    return belief._replace(cov=belief.cov + np.kron(added, np.eye(3)), noise_scale=max(belief.noise_scale, 1.0))


@njit(cache=True, error_model="numpy")
def _propagate(
    mean: Array, cov: Array, dt_s: float, density: float, decay_s: tuple[float, float]
) -> tuple[Array, Array, Array]:
    F, Q = discretise(len(mean), dt_s, decay_s)
    F_axes = _for_all_axes(F)
    cross = cov @ F_axes.T
    P = F_axes @ cross + density * _for_all_axes(Q)
    return F @ mean, 0.5 * (P + P.T), cross


@njit(cache=True, error_model="numpy")
def _innovation(mean: Array, cov: Array, position: Array, R: Array) -> tuple[Array, Array, float]:
    nu = position - mean[0]
    S_inverse = np.linalg.inv(cov[:3, :3] + R)
    return nu, S_inverse, nu @ S_inverse @ nu


@njit(cache=True, error_model="numpy")
def _condition(mean: Array, cov: Array, nu: Array, S_inverse: Array) -> tuple[Array, Array]:
    HP = cov[:3]
    K = HP.T @ S_inverse
    P = cov - K @ HP
    return mean + (K @ nu).reshape(mean.shape), 0.5 * (P + P.T)


@njit(cache=True, error_model="numpy")
def _for_all_axes(M: Array) -> Array:
    """M ⊗ I₃ (`np.kron` is slow in numba)."""
    n = len(M)
    whole = np.zeros((3 * n, 3 * n))
    for axis in range(3):
        whole[axis::3, axis::3] = M
    return whole


@njit(cache=True, error_model="numpy")
def discretise(order: int, dt_s: float, decay_s: tuple[float, float]) -> tuple[Array, Array]:
    """F = e^(A·dt) and Q = ∫₀^dt e^(A·s) G Gᵀ e^(Aᵀ·s) ds of ẋ = A x + G w for one axis, w white of unit density.

    x are position and its derivatives.  Order 1: ṗ = w.  Order 2: v̇ = w.  Order 3: (d/dt + 1/τ) a = w (Singer 1970).
    Order 4: (d/dt + 1/τ)(d/dt + 1/τ′) a = w.  `decay_s` are τ and τ′; without decay (inf) the derivative above the
    highest is w.

    Both are power series over a step h that is short against the decay, doubled by F(2h) = F(h)² and
    Q(2h) = F(h) Q(h) F(h)ᵀ + Q(h).  Exact to rounding.
    """
    rates = (1 / decay_s[0] if order > 2 else 0.0, 1 / decay_s[1] if order > 3 else 0.0)
    fastest = max(rates) * dt_s
    doublings = max(math.ceil(math.log2(4 * fastest)), 0) if fastest > 0 else 0
    h = dt_s / 2**doublings
    F = np.eye(order)
    Q = np.zeros((order, order))
    Q[-1, -1] = h
    term_F = F.copy()  # (A h)ᵐ / m!
    term_Q = Q.copy()
    for m in range(1, _TERMS):
        term_F = _derivative(term_F, rates) * h / m
        half_Q = _derivative(term_Q, rates)
        term_Q = (half_Q + half_Q.T) * h / (m + 1)
        F += term_F
        Q += term_Q
    for _ in range(doublings):
        Q += F @ Q @ F.T
        F = F @ F
    return F, Q


@njit(cache=True, error_model="numpy")
def _derivative(x: Array, rates: tuple[float, float]) -> Array:
    """A·x: the rows of x move up by one, the last row decays."""
    result = np.zeros_like(x)
    result[:-1] = x[1:]
    if len(x) == 3:
        result[2] = -rates[0] * x[2]
    elif len(x) == 4:
        result[3] = -rates[0] * rates[1] * x[2] - (rates[0] + rates[1]) * x[3]
    return result
