"""Kalman filter on position and its derivatives, for measurements at any stamps (R, "Kalman filter").

The matrix code is compiled by numba: for matrices this small, calls on arrays would take most of the time.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.jit import njit
from pps_vision.types import Array, Track3D
from tracking import DEFAULT_ORDER

_REFERENCE_M = 0.4  # where peripersonal space is learned; the defaults are meant for there
_AT_REST_CHI2 = 11.3  # the 99 % quantile with three degrees of freedom
_TERMS = 16  # of a power series
_STEADY = 0.025  # noise scale of what moves straight at constant speed
# Least (0.005 and 0.012 do about as well; chosen like `stereo._TO_FIRST`); back and forth once a second.
_NOISE_SCALES = (0.008, 30.0)
# Chosen on training recordings (bench filter, seeds 8300 and 8310: 36 rendered balls and markers at 5–30 cm/s; every
# second flight of tt3d): no error of order 3 and 4 larger than without decay, coverage of velocity nearest to 68 and
# 95 %.
NOISE_DENSITY = {1: 4e-3, 2: 1.5e-3, 3: 0.2, 4: 270.0}


@dataclass(frozen=True)
class KalmanParams:
    """Parameters for an object at 0.4 m; `scaled` gives those for another distance, `of_order` those of an order."""

    order: int = DEFAULT_ORDER
    """How many of position, velocity, acceleration and jerk are modelled, 1–4 (R: 4)."""
    noise_density: float = NOISE_DENSITY[DEFAULT_ORDER]
    """Spectral density of the white noise that drives the derivative above the highest modelled one, (m/s^order)²·s,
    when the filter starts and where the motion jumps."""
    prior_std: tuple[float, float, float] = (0.3, 0.5, 2.0)
    """Standard deviation of velocity, acceleration and jerk before they were observed, m/s, m/s², m/s³."""
    white_share: float = 0.4
    """Share of a measurement's covariance, but for what is known to last, that is independent from frame to frame; the
    rest is a correlated error, which no filtering averages out."""
    adaptation_rate: float = 0.2
    """Rate at which the process noise follows the innovations; 0 keeps it constant."""
    gate_chi2: float = 14.0
    """Squared Mahalanobis distance (3 degrees of freedom) above which the motion may have jumped."""
    jump_chi2: float = 26.0
    """The same, of a belief whose motion may have jumped, above which it is an outlier (1e-5 of a χ² distribution)."""
    max_rejections: int = 3
    """Number of outliers in a row after which the filter starts again from the newest."""
    decay_s: tuple[float, float] = (0.4, 0.03)
    """Time constants with which acceleration and jerk decay (`discretise`); inf: no decay, as in R."""

    def __post_init__(self) -> None:
        if self.order not in NOISE_DENSITY:
            raise InputError("Kalman filter", f"filter order {self.order}; expected 1, 2, 3 or 4")
        if not (self.noise_density > 0 and self.gate_chi2 > 0 and self.jump_chi2 > 0 and self.max_rejections >= 1):
            raise InputError(
                "Kalman filter",
                f"noise density {self.noise_density}, gate {self.gate_chi2}, gate of jumps {self.jump_chi2}, "
                f"rejections {self.max_rejections}: expected positive numbers",
            )
        if not 0 < self.white_share <= 1:
            raise InputError("Kalman filter", f"white share {self.white_share}; expected more than 0 and at most 1")
        if not min(self.decay_s) > 0:
            raise InputError(
                "Kalman filter", f"acceleration and jerk decay within {self.decay_s} s; expected more than 0"
            )
        if not 0 <= self.adaptation_rate <= 1:
            raise InputError("Kalman filter", f"adaptation rate {self.adaptation_rate}; expected 0 to 1")

    @classmethod
    def of_order(cls, order: int) -> "KalmanParams":
        """The defaults of an order, with the process noise chosen for it; ValueError for another than 1 to 4."""
        return cls(order, NOISE_DENSITY.get(order, 1.0))


def scaled(params: KalmanParams, distance_m: float) -> KalmanParams:
    """The same filter for an object at another distance: what is far away (or given in another unit)
    moves and changes as fast in the image, so its lengths grow with the distance; 0.4 m is 1."""
    scale = distance_m / _REFERENCE_M
    std = tuple(scale * value for value in params.prior_std)
    return replace(params, noise_density=params.noise_density * scale**2, prior_std=(std[0], std[1], std[2]))


class Belief(NamedTuple):  # constructing a frozen dataclass is three times slower
    """`mean` (order, 3) and `cov` (3·order, 3·order) of the state at `stamp_s`, but for the error `correlated_cov`
    (3, 3) m² of the position that the measurements share; when it was last updated; `rejections` so far in
    a row; `nis` the last innovation's squared Mahalanobis distance (expected 3), NaN before the first; `noise_scale`
    how much denser the process noise is than the parameters' own."""

    stamp_s: float
    mean: Array
    cov: Array
    correlated_cov: Array
    updated_s: float
    rejections: int = 0
    nis: float = float("nan")
    noise_scale: float = 1.0


@njit(cache=True, error_model="numpy")
def discretise(order: int, dt_s: float, decay_s: tuple[float, float]) -> tuple[Array, Array]:
    """F = e^(A·dt) and Q = ∫₀^dt e^(A·s) G Gᵀ e^(Aᵀ·s) ds of ẋ = A x + G w for one axis, w white of unit density.

    x are position and its derivatives.  Order 1: ṗ = w.  Order 2: v̇ = w.  Order 3: (d/dt + 1/τ) a = w (Singer 1970).
    Order 4: (d/dt + 1/τ)(d/dt + 1/τ′) a = w.  `decay_s` are τ and τ′; without decay (inf) the derivative above the
    highest is w.

    Both are power series over a step that is short against the decay; F(2h) = F(h)², Q(2h) = F(h) Q(h) F(h)ᵀ + Q(h)
    double it to any length.  Exact to rounding.
    """
    rates = (1 / decay_s[0] if order > 2 else 0.0), (1 / decay_s[1] if order > 3 else 0.0)
    fastest = max(rates) * dt_s
    doublings = max(math.ceil(math.log2(4 * fastest)), 0) if fastest > 0 else 0
    h = dt_s / 2**doublings
    term_F, term_Q, change = np.eye(order), np.zeros((order, order)), np.empty((order, order))
    term_Q[-1, -1] = h
    F: Array = term_F.copy()
    Q: Array = term_Q.copy()
    for m in range(1, _TERMS):
        _derivative(term_F, rates, change)
        for i in range(order):
            for j in range(order):
                term_F[i, j] = change[i, j] * h / m
                F[i, j] += term_F[i, j]
        _derivative(term_Q, rates, change)
        for i in range(order):
            for j in range(order):
                term_Q[i, j] = (change[i, j] + change[j, i]) * h / (m + 1)
                Q[i, j] += term_Q[i, j]
    for _ in range(doublings):
        Q += _product(_product(F, Q), F.T)
        F = _product(F, F)
    return F, Q


@njit(cache=True, error_model="numpy")
def _derivative(x: Array, rates: tuple[float, float], result: Array) -> None:
    """A·x into `result`: each row is the next one of x, the last what decays."""
    n = len(x)
    for column in range(n):
        for i in range(n - 1):
            result[i, column] = x[i + 1, column]
        result[n - 1, column] = 0.0
        if n == 3:
            result[2, column] = -rates[0] * x[2, column]
        elif n == 4:
            result[3, column] = -rates[0] * rates[1] * x[2, column] - (rates[0] + rates[1]) * x[3, column]


@njit(cache=True, error_model="numpy")
def _product(a: Array, b: Array) -> Array:
    n = len(a)
    c = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                c[i, j] += a[i, k] * b[k, j]
    return c


def start(
    params: KalmanParams,
    stamp_s: float,
    position: Array,
    cov: Array,
    velocity: Array | None = None,
    velocity_cov: Array | None = None,
    correlated: Array | None = None,
) -> Belief:
    """The belief after the first measurement.

    Args:
        position: (3,) m, with `cov` (3, 3) m², of which the part `correlated` (3, 3) m² is known to last (None: 0).
        velocity: (3,) m/s, if it was measured too, with `velocity_cov` (3, 3) m²/s²; else the prior of `prior_std`
            holds.  An order of 1 has no velocity to set.

    Raises:
        ValueError: A velocity without a covariance, or the reverse.
    """
    if (velocity is None) != (velocity_cov is None):
        raise ValueError("velocity and velocity_cov: one is missing; expected both or neither")
    mean = np.zeros((params.order, 3))
    mean[0] = position
    prior = np.array([0.0, *params.prior_std[: params.order - 1]])
    P = np.kron(np.diag(prior**2), np.eye(3))
    white = _white(params, 1.0, cov, correlated)
    P[:3, :3] = white
    if velocity is not None and params.order > 1:
        mean[1], P[3:6, 3:6] = velocity, velocity_cov
    return Belief(stamp_s, mean, P, cov - white, stamp_s)


def predict(params: KalmanParams, belief: Belief, stamp_s: float) -> Belief:
    """The belief at a later stamp; ValueError for an earlier one."""
    return forecast(params, belief, stamp_s)[0]


def forecast(params: KalmanParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The same, and the covariance (3·order, 3·order) of the state now with the state then (for smoothing)."""
    dt = stamp_s - belief.stamp_s
    if not dt >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    b = belief
    mean, P, cross = _moved(b.mean, b.cov, dt, b.noise_scale * params.noise_density, params.decay_s)
    return Belief(stamp_s, mean, P, b.correlated_cov, b.updated_s, b.rejections, b.nis, b.noise_scale), cross


@njit(cache=True, error_model="numpy")
def _moved(
    mean: Array, cov: Array, dt_s: float, density: float, decay_s: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """F·mean, F P Fᵀ + Q and P Fᵀ, the axes moving by themselves; symmetric to the last bit: rounding must not add
    up."""
    n = len(mean)
    F, Q = discretise(n, dt_s, decay_s)
    ahead, cross, P = np.zeros_like(mean), np.zeros_like(cov), np.zeros_like(cov)
    for i in range(n):
        for j in range(n):
            for axis in range(3):
                ahead[i, axis] += F[i, j] * mean[j, axis]
                for row in range(3 * n):
                    cross[row, 3 * i + axis] += cov[row, 3 * j + axis] * F[i, j]
    for i in range(n):
        for axis in range(3):
            row = 3 * i + axis
            for column in range(row, 3 * n):
                for j in range(n):
                    P[row, column] += F[i, j] * cross[3 * j + axis, column]
                if column % 3 == axis:
                    P[row, column] += density * Q[i, column // 3]
                P[column, row] = P[row, column]
    return ahead, P, cross


def ahead(params: KalmanParams, track: Track3D, dt_s: float, period_s: float = 0.0) -> tuple[Array, Array]:
    """Position (3,) m of a known track predicted `dt_s` after its stamp, and velocity (3,) m/s half a period later.

    The motion counts by the share of its velocity's squared Mahalanobis length χ² that is above what a target at rest
    shows in 99 % of cases, so that the noise of what rests is not followed.
    """
    mean, velocity = track.mean, track.velocity
    chi2 = float(velocity @ np.linalg.solve(track.cov[3:6, 3:6] + 1e-12 * np.eye(3), velocity))
    share = max(0.0, 1 - _AT_REST_CHI2 / chi2) if chi2 > 0 else 0.0
    then = discretise(len(mean), dt_s, params.decay_s)[0] @ mean
    midway = discretise(len(mean), dt_s + 0.5 * period_s, params.decay_s)[0] @ mean
    return track.position + share * (then[0] - track.position), share * midway[1]


def update(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None = None
) -> Belief:
    """The belief after a measured `position` (3,) m with `cov` (3, 3) m² at its stamp, of which the part `correlated`
    (3, 3) m² is known to last from frame to frame (None: 0).

    A measurement outside the gate is first taken for a sudden change of motion (everything but the
    position as uncertain as at the start); outside that too it is an outlier, which leaves the state
    as it was and counts.  The one after too many restarts the filter.
    """
    gated = gate(params, belief, position, cov, correlated)
    if gated is None:
        if belief.rejections + 1 >= params.max_rejections:
            return start(params, belief.stamp_s, position, cov, correlated=correlated)
        return belief._replace(rejections=belief.rejections + 1)
    return correct(params, gated)


class GatedMeasurement(NamedTuple):
    """A measurement that fits a belief: the belief it fits, squared Mahalanobis distance of the difference ν from
    what was expected, (4, 3) what to multiply the covariance's first three rows with: L⁻¹, and below it
    ν weighed by its covariance L Lᵀ; and (3, 3) m² of the measurement's error that filtering does not average out."""

    belief: Belief
    nis: float
    weights: Array
    correlated_cov: Array


def gate(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None = None
) -> GatedMeasurement | None:
    """The measurement beside the belief it fits, as it is or inflated; None for an outlier.  Args: As for `update`."""
    gated = _compared(params, belief, position, cov, correlated)
    if gated.nis <= params.gate_chi2:
        return gated
    gated = _compared(params, _inflated(params, belief), position, cov, correlated)
    return gated if gated.nis <= params.jump_chi2 else None


def correct(params: KalmanParams, gated: GatedMeasurement) -> Belief:
    """The belief after a gated measurement."""
    before = gated.belief
    mean, P = _corrected(before.mean, before.cov, gated.weights)
    noise_scale = _adapted_scale(params, before.noise_scale, gated.nis)
    return Belief(before.stamp_s, mean, P, gated.correlated_cov, before.stamp_s, 0, gated.nis, noise_scale)


def _white(params: KalmanParams, noise_scale: float, cov: Array, correlated: Array | None) -> Array:
    """(3, 3) m² of a measurement's error that is independent from frame to frame.

    Where innovations are smaller than even steady motion explains, its share falls with the process noise: a
    measurement weighs as much as before, and the state's covariance falls to what the innovations show.
    """
    share = params.white_share * min(noise_scale / _STEADY, 1.0)
    white: Array = share * (cov if correlated is None else cov - correlated)
    return white


def _adapted_scale(params: KalmanParams, before: float, nis: float) -> float:
    """Up where innovations are larger than expected, down where they are smaller."""
    factor = math.exp(min(params.adaptation_rate * (nis / 3 - 1), 100.0))  # a wide gate does not overflow
    return min(max(before * factor, _NOISE_SCALES[0]), _NOISE_SCALES[1])


@njit(cache=True, error_model="numpy")
def _corrected(mean: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """The state's mean and covariance, as symmetric as before."""
    size = len(cov)
    taken, corrected, P = np.zeros((4, size)), np.empty_like(mean), np.empty_like(cov)
    for row in range(4):
        for k in range(3):
            for column in range(size):
                taken[row, column] += weights[row, k] * cov[k, column]
    for i in range(size):
        corrected[i // 3, i % 3] = mean[i // 3, i % 3] + taken[3, i]
        for j in range(i, size):
            P[i, j] = cov[i, j] - (taken[0, i] * taken[0, j] + taken[1, i] * taken[1, j] + taken[2, i] * taken[2, j])
            P[j, i] = P[i, j]
    return corrected, P


def _compared(
    params: KalmanParams, belief: Belief, position: Array, cov: Array, correlated: Array | None
) -> GatedMeasurement:
    white = _white(params, belief.noise_scale, cov, correlated)
    nis, weights = _weighed(belief.mean, belief.cov, position, white)
    return GatedMeasurement(belief, nis, weights, cov - white)


@njit(cache=True, error_model="numpy")
def _weighed(mean: Array, cov: Array, position: Array, R: Array) -> tuple[float, Array]:
    """`nis` and `weights` of `GatedMeasurement`; L is Cholesky's."""
    i = 1 / math.sqrt(cov[0, 0] + R[0, 0])
    bi, ci = (cov[0, 1] + R[0, 1]) * i, (cov[0, 2] + R[0, 2]) * i
    j = 1 / math.sqrt(cov[1, 1] + R[1, 1] - bi * bi)
    ej = (cov[1, 2] + R[1, 2] - bi * ci) * j
    k = 1 / math.sqrt(cov[2, 2] + R[2, 2] - ci * ci - ej * ej)
    ij, jk = -bi * i * j, -ej * j * k
    ik = -(ci * i + ej * ij) * k
    x, y, z = position[0] - mean[0, 0], position[1] - mean[0, 1], position[2] - mean[0, 2]
    x, y, z = i * x, ij * x + j * y, ik * x + jk * y + k * z
    weights = np.zeros((4, 3))
    weights[0, 0], weights[1, 0], weights[1, 1], weights[2, 0], weights[2, 1], weights[2, 2] = i, ij, j, ik, jk, k
    weights[3, 0], weights[3, 1], weights[3, 2] = i * x + ij * y + ik * z, j * y + jk * z, k * z
    return x * x + y * y + z * z, weights


def _inflated(params: KalmanParams, belief: Belief) -> Belief:
    """As if the motion had begun anew at the last update, perhaps the other way: its prior spread added to every
    derivative, to the velocity twice its amount besides, and as much noise_scale as at the start."""
    prior = np.diag([0.0, *params.prior_std[: params.order - 1]]) ** 2
    if params.order > 1:
        velocity = belief.mean[1]
        prior[1, 1] += 4 * float(velocity @ velocity)
    F = discretise(params.order, belief.stamp_s - belief.updated_s, params.decay_s)[0]
    cov = belief.cov + np.kron(F @ prior @ F.T, np.eye(3))
    return belief._replace(cov=cov, noise_scale=max(belief.noise_scale, 1.0))
