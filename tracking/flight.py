"""Motion of a thrown ball: gravity, drag, the lift of its spin, and its bounce on a level surface.

The state is position, velocity and lift L (its spin times a constant): the acceleration of spin is L × v.
It has the shape of a Kalman filter's state of order 3, so `kalman.update` takes the measurements in; the
prediction carries the mean and its neighbours one standard deviation away through flight and bounce
(second-order central differences, Nørgaard, Poulsen and Ravn 2000).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pps_vision.errors import InputError
from pps_vision.types import Array, Mask
from tracking import kalman
from tracking.kalman import Belief, KalmanParams

GRAVITY_M_S2 = 9.81
_GRAVITY = np.array([0.0, 0.0, -GRAVITY_M_S2])
_N = 9


@dataclass(frozen=True)
class FlightParams:
    """Flight model, in metres.

    The defaults are a table-tennis ball's, fitted to recorded flights (docs/speed_accuracy.md).
    """

    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Upward direction in the root frame, of any length."""
    drag_per_m: float = 0.14
    """Deceleration over squared speed."""
    speed_std: float = 8.0
    """Standard deviation of each velocity component before it was observed, m/s."""
    lift_std: tuple[float, float] = (0.3, 0.1)
    """Standard deviation of the level and the upright component of the lift, 1/s; sidespin is rarer."""
    noise_density: float = 0.08
    """Spectral density of unmodelled acceleration, (m/s²)²·s."""
    floor_m: float = 0.016
    """Height along `up` of the ball's centre at the bounce; −inf: no floor."""
    restitution: float = 0.935
    """Share of the vertical velocity that a bounce keeps."""
    grip: float = 0.86
    """Share of the horizontal velocity that a bounce keeps."""
    drive_m: float = 0.65
    """Horizontal velocity that spin adds at a bounce, m/s per 1/s of lift."""
    spin_kept: float = 0.6
    """Share of the spin that a bounce keeps."""
    bounce_std: tuple[float, float, float] = (0.6, 0.06, 0.08)
    """Standard deviation of the velocity after a bounce along, across and up, m/s."""
    bounce_lift_std: float = 0.12
    """Standard deviation of the lift after a bounce, 1/s."""
    gate_chi2: float = 20.0
    """Gate of the Kalman filter (`KalmanParams.gate_chi2`)."""
    white_share: float = KalmanParams().white_share
    """As `KalmanParams.white_share`."""

    def __post_init__(self) -> None:
        if not (self.drag_per_m >= 0 and self.noise_density > 0 and 0 <= self.restitution <= 1):
            raise InputError(
                "flight model",
                f"drag {self.drag_per_m}, noise density {self.noise_density}, restitution {self.restitution}; "
                "expected drag ≥ 0, a noise density > 0 and a restitution from 0 to 1",
            )
        if not 0 < math.hypot(*self.up) < math.inf:
            raise InputError("flight model", f"upward direction {self.up}; expected three numbers, not all 0")

    @cached_property
    def filter(self) -> KalmanParams:
        """How measurements are taken in: as by a Kalman filter of order 3."""
        std = (self.speed_std, self.lift_std[0], 1.0)
        never = (np.inf, np.inf)
        return KalmanParams(3, self.noise_density, std, self.white_share, gate_chi2=self.gate_chi2, decay_s=never)

    @cached_property
    def R_upright_root(self) -> Array:
        """(3, 3) rotation from the root frame into one whose z points up."""
        z = np.array(self.up) / math.hypot(*self.up)
        x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        return np.array([x, np.cross(z, x), z])


def start(
    params: FlightParams,
    stamp_s: float,
    position: Array,
    cov: Array,
    velocity: Array | None = None,
    velocity_cov: Array | None = None,
    correlated: Array | None = None,
) -> Belief:
    """The belief after the first measurement; the arguments are those of `kalman.start`."""
    belief = kalman.start(params.filter, stamp_s, position, cov, velocity, velocity_cov, correlated)
    R = params.R_upright_root
    belief.cov[6:, 6:] = (R.T * np.square([params.lift_std[0], *params.lift_std])) @ R
    return belief


def forecast(params: FlightParams, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The belief at a later stamp, and the covariance (9, 9) of the state now with the state then;
    ValueError for an earlier stamp."""
    dt = stamp_s - belief.stamp_s
    if not dt >= 0:
        raise ValueError(f"stamp {stamp_s:.6f} s lies before {belief.stamp_s:.6f} s; expected rising stamps")
    R = np.kron(np.eye(3), params.R_upright_root)
    spread = np.linalg.cholesky(R @ belief.cov @ R.T).T
    around = np.concatenate([spread, -spread, np.zeros((1, _N))])
    then, since = _fly(params, R @ belief.mean.ravel() + around, dt)
    neighbours = then[:-1] - then[-1]
    mean = then[-1] + 0.5 * neighbours.sum(axis=0)
    P = 0.5 * neighbours.T @ neighbours
    P[:6, :6] += params.noise_density * np.kron(kalman.discretise(2, dt, params.filter.decay_s)[1], np.eye(3))
    share = float(np.mean(since > 0))
    if share > 0:
        P += share * _bounce_noise(params, mean[3:5], float(since.sum()) / np.count_nonzero(since))
    ahead = belief._replace(stamp_s=stamp_s, mean=(R.T @ mean).reshape(3, 3), cov=R.T @ P @ R, noise_scale=1.0)
    return ahead, R.T @ (0.5 * around[:-1].T @ neighbours) @ R


def derivatives(params: FlightParams, belief: Belief) -> tuple[Array, Array]:
    """Position, velocity and acceleration in the air (3, 3), root frame, and their covariance (9, 9) to first order."""
    R = params.R_upright_root
    (p, v, lift), speed = belief.mean, float(np.linalg.norm(belief.mean[1]))
    a = R.T @ _acceleration(params, (R @ v)[None], (R @ lift)[None])[0]
    J = np.eye(_N)
    J[6:, 3:6] = _cross(lift) - params.drag_per_m * (speed * np.eye(3) + np.outer(v, v) / max(speed, 1e-9))
    J[6:, 6:] = -_cross(v)
    return np.array([p, v, a]), J @ belief.cov @ J.T


def _cross(a: Array) -> Array:
    """(3, 3) matrix of a × ·."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _fly(params: FlightParams, states: Array, dt: float) -> tuple[Array, Array]:
    """States (m, 9) after `dt`, and how long ago each bounced (m,), 0 for those that did not."""
    p, v, lift = states[:, :3], states[:, 3:6], states[:, 6:]
    p_end, v_end = _arc(params, p, v, lift, dt)
    hit = (p_end[:, 2] < params.floor_m) & (v_end[:, 2] < 0)
    since = np.zeros(len(states))
    if hit.any():
        p_end[hit], v_end[hit], lift, since[hit] = _bounce(params, p, v, lift, hit, dt)
    return np.hstack([p_end, v_end, lift]), since


def _bounce(
    params: FlightParams, p: Array, v: Array, lift: Array, hit: Mask, dt: float
) -> tuple[Array, Array, Array, Array]:
    """Position, velocity and time since the bounce of those that `hit`, and the lift of all."""
    down = _acceleration(params, v[hit], lift[hit])[:, 2]
    fall, drop = v[hit, 2], np.maximum(p[hit, 2] - params.floor_m, 0.0)
    until = np.clip((-fall - np.sqrt(np.maximum(fall**2 - 2 * down * drop, 0.0))) / down, 0.0, dt)[:, None]
    at, into = _arc(params, p[hit], v[hit], lift[hit], until)
    spin = lift[hit]
    out = into * (params.grip, params.grip, -params.restitution)
    out[:, 0] += params.drive_m * spin[:, 1]
    out[:, 1] -= params.drive_m * spin[:, 0]
    kept = lift.copy()
    kept[hit] *= params.spin_kept
    p_end, v_end = _arc(params, at, out, kept[hit], dt - until)
    return p_end, v_end, kept, dt - until[:, 0]


def _arc(params: FlightParams, p: Array, v: Array, lift: Array, dt: float | Array) -> tuple[Array, Array]:
    """Position and velocity (m, 3) after free flight, by the midpoint rule."""
    a = _acceleration(params, v, lift)
    a = _acceleration(params, v + 0.5 * dt * a, lift)
    return p + dt * v + 0.5 * dt * dt * a, v + dt * a


def _acceleration(params: FlightParams, v: Array, lift: Array) -> Array:
    """(m, 3) m/s² of gravity, drag and spin."""
    speed = np.sqrt(np.einsum("ij,ij->i", v, v))[:, None]
    spin: Array = lift[:, (1, 2, 0)] * v[:, (2, 0, 1)] - lift[:, (2, 0, 1)] * v[:, (1, 2, 0)]  # lift × v
    return _GRAVITY - params.drag_per_m * speed * v + spin


def _bounce_noise(params: FlightParams, horizontal: Array, since_s: float) -> Array:
    """(9, 9) covariance that a bounce `since_s` ago leaves, for a ball that moves on along `horizontal`."""
    x, y = horizontal / max(float(np.linalg.norm(horizontal)), 1e-9)
    turn = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
    V = (turn * np.square(params.bounce_std)) @ turn.T
    P = np.zeros((_N, _N))
    P[:3, :3], P[:3, 3:6], P[3:6, :3], P[3:6, 3:6] = since_s**2 * V, since_s * V, since_s * V, V
    P[6:, 6:] = params.bounce_lift_std**2 * np.eye(3)
    return P
