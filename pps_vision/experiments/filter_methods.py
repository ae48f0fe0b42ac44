"""Filters side by side: ours of every order, ours that chooses its order, a constant gain, a flight model, peers."""

from dataclasses import replace
from typing import Protocol

import cv2
import numpy as np
from scipy.linalg import solve_discrete_are

from pps_vision.experiments.filter_scenes import Sequence
from pps_vision.types import Array
from tracking import flight, kalman
from tracking.flight import FlightParams
from tracking.kalman import Belief, KalmanParams, discretise, scaled
from tracking.names import DEFAULT_ORDER
from tracking.smoother import Measured, Passage, follow, smooth

State = Array  # (order, 3) position, velocity, …


class Filter(Protocol):
    """Made for a sequence, of which it looks at nothing but the first measurement; then a step a measurement."""

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """The state after the next measurement."""
        ...


class Ours:
    """The default's filter at an order."""

    def __init__(self, order: int, sequence: Sequence) -> None:
        self.params = _params(sequence, order)
        self.belief = _first(self.params, sequence)

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update."""
        ahead = kalman.predict(self.params, self.belief, stamp_s)
        self.belief = kalman.update(self.params, ahead, position, cov)
        return self.belief.mean


class Flight:
    """A thrown ball's."""

    def __init__(self, sequence: Sequence) -> None:
        self.params = FlightParams()
        self.belief = flight.start(self.params, sequence.stamps_s[0], sequence.positions[0], sequence.covs[0])

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update."""
        ahead = flight.forecast(self.params, self.belief, stamp_s)[0]
        self.belief = kalman.update(self.params.filter, ahead, position, cov)
        return self.belief.mean


class Automatic:
    """Filters of all orders in parallel, so quiet that each fits only where its model holds; the lowest whose
    innovations were consistent of late speaks, the default's if none."""

    QUIET = (1e-7, 1e-3, 0.2, 270.0)  # noise densities of orders 1–4
    MEMORY, MOST_NIS = 6.0, 4.5

    def __init__(self, sequence: Sequence) -> None:
        self.filters = [_params(sequence, order, density) for order, density in enumerate(self.QUIET, start=1)]
        self.beliefs = [_first(one, sequence) for one in self.filters]
        self.nis = np.full(len(self.filters), 3.0)

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update all."""
        for k, (params, belief) in enumerate(zip(self.filters, self.beliefs, strict=True)):
            ahead = kalman.predict(params, belief, stamp_s)
            innovation = position - ahead.mean[0]
            S = ahead.cov[:3, :3] + params.white_share * cov
            surprise = min(float(innovation @ np.linalg.solve(S, innovation)), 10 * self.MOST_NIS)
            self.nis[k] += (surprise - self.nis[k]) / self.MEMORY
            self.beliefs[k] = kalman.update(params, ahead, position, cov)
        fits = np.flatnonzero(self.nis <= self.MOST_NIS)
        return self.beliefs[int(fits[0]) if len(fits) else DEFAULT_ORDER - 1].mean


class Steady:
    """The default's model with the gain that the Riccati equation settles at, for the sequence's usual variance and
    step (which it alone is told beforehand); no covariance is carried, nothing is gated."""

    def __init__(self, sequence: Sequence) -> None:
        params = _params(sequence)
        n, dt = params.order, float(np.median(np.diff(sequence.stamps_s)))
        self.decay_s, (self.A, Q) = params.decay_s, discretise(n, dt, params.decay_s)
        R = params.white_share * float(np.median(np.trace(sequence.covs, axis1=1, axis2=2))) / 3
        ahead = solve_discrete_are(self.A.T, np.eye(n)[:, :1], params.noise_density * Q, np.array([[R]]))
        self.gain = ahead[:, :1] / (ahead[0, 0] + R)
        self.back = (ahead - self.gain @ ahead[:1]) @ self.A.T @ np.linalg.inv(ahead)  # of the smoother
        self.mean = _first(params, sequence).mean
        self.stamp_s, self.dt_s = float(sequence.stamps_s[0]), dt

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update; an unusual step has its own transition but the usual gain."""
        dt, self.stamp_s = stamp_s - self.stamp_s, stamp_s
        usual = abs(dt - self.dt_s) < 1e-4
        ahead = (self.A if usual else discretise(len(self.A), dt, self.decay_s)[0]) @ self.mean
        self.mean = ahead + self.gain * (position - ahead[0])
        return self.mean


class _Clock:
    """The default's matrices for each step, made anew only where its length changes."""

    def __init__(self, params: KalmanParams, stamp_s: float) -> None:
        self.params, self.stamp_s, self.dt_s = params, stamp_s, np.nan

    def advance(self, stamp_s: float) -> tuple[Array, Array] | None:
        """Transition and process noise (3·order, 3·order) of the step to a stamp; None where they are the last
        one's."""
        dt, self.stamp_s = stamp_s - self.stamp_s, stamp_s
        if abs(dt - self.dt_s) <= 1e-6:
            return None
        self.dt_s = dt
        return _matrices(self.params, dt)


class OpenCV:
    """cv2.KalmanFilter with the default's matrices."""

    def __init__(self, sequence: Sequence) -> None:
        self.params = _params(sequence)
        belief = _first(self.params, sequence)
        n = belief.mean.size
        self.kf = cv2.KalmanFilter(n, 3, 0, cv2.CV_64F)
        self.kf.measurementMatrix = np.eye(3, n)
        self.kf.statePost, self.kf.errorCovPost = belief.mean.reshape(n, 1), belief.cov
        self.clock = _Clock(self.params, belief.stamp_s)

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update."""
        if changed := self.clock.advance(stamp_s):
            self.kf.transitionMatrix, self.kf.processNoiseCov = changed
        self.kf.measurementNoiseCov = self.params.white_share * cov
        self.kf.predict()
        return np.asarray(self.kf.correct(position.reshape(3, 1)), dtype=float).reshape(-1, 3)


class FilterPy:
    """filterpy's KalmanFilter with the default's matrices; only made where filterpy is installed."""

    def __init__(self, sequence: Sequence) -> None:
        from filterpy.kalman import KalmanFilter

        self.params = _params(sequence)
        belief = _first(self.params, sequence)
        n = belief.mean.size
        self.kf = KalmanFilter(dim_x=n, dim_z=3)
        self.kf.H, self.kf.x, self.kf.P = np.eye(3, n), belief.mean.reshape(n, 1), belief.cov.copy()
        self.clock = _Clock(self.params, belief.stamp_s)

    def step(self, stamp_s: float, position: Array, cov: Array) -> State:
        """Predict and update."""
        if changed := self.clock.advance(stamp_s):
            self.kf.F, self.kf.Q = changed
        self.kf.predict()
        self.kf.update(position.reshape(3, 1), R=self.params.white_share * cov)
        return np.asarray(self.kf.x, dtype=float).reshape(-1, 3)


def smoothed_ours(order: int, sequence: Sequence) -> list[State]:
    """Our filter and the backward pass."""
    params = _params(sequence, order)
    return _means(follow(params, _first(params, sequence), measured(sequence)))


def smoothed_flight(sequence: Sequence) -> list[State]:
    """The flight model's."""
    params = FlightParams()
    begin = flight.start(params, sequence.stamps_s[0], sequence.positions[0], sequence.covs[0])
    return _means(follow(params.filter, begin, measured(sequence), lambda b, t: flight.forecast(params, b, t)))


def smoothed_steady(sequence: Sequence) -> list[State]:
    """The constant gain's, backward with a constant gain too."""
    steady = Steady(sequence)
    after = [steady.mean]
    for stamp_s, z, cov in zip(sequence.stamps_s[1:], sequence.positions[1:], sequence.covs[1:], strict=True):
        after.append(steady.step(stamp_s, z, cov))
    path = [after[-1]]
    for mean in after[-2::-1]:
        path.append(mean + steady.back @ (path[-1] - steady.A @ mean))
    return path[::-1]


def smoothed_filterpy(sequence: Sequence) -> list[State]:
    """filterpy's `batch_filter` and `rts_smoother`."""
    peer = FilterPy(sequence)
    peer.kf.x, dts = peer.kf.x.ravel(), np.diff(sequence.stamps_s)
    Fs, Qs = (list(of) for of in zip(*(_matrices(peer.params, dt) for dt in dts), strict=True))
    zs, Rs = list(sequence.positions[1:]), [peer.params.white_share * cov for cov in sequence.covs[1:]]
    first, P = peer.kf.x.copy(), peer.kf.P.copy()
    xs, Ps, _, _ = peer.kf.batch_filter(zs, Fs=Fs, Qs=Qs, Rs=Rs)
    xs, Ps = np.concatenate([first[None], xs]), np.concatenate([P[None], Ps])
    path = peer.kf.rts_smoother(xs, Ps, Fs=[*Fs, Fs[-1]], Qs=[*Qs, Qs[-1]])[0]
    return [x.reshape(-1, 3) for x in path]


def measured(sequence: Sequence) -> list[Measured]:
    """All measurements but the first."""
    rows = zip(sequence.stamps_s[1:], sequence.positions[1:], sequence.covs[1:], strict=True)
    return [Measured(float(stamp_s), position, cov) for stamp_s, position, cov in rows]


def _params(sequence: Sequence, order: int = DEFAULT_ORDER, density: float | None = None) -> KalmanParams:
    params = KalmanParams.of_order(order)
    own = replace(params, white_share=sequence.white_share, noise_density=density or params.noise_density)
    return scaled(own, sequence.distance_m)


def _first(params: KalmanParams, sequence: Sequence) -> Belief:
    return kalman.start(params, float(sequence.stamps_s[0]), sequence.positions[0], sequence.covs[0])


def _means(passages: list[Passage]) -> list[State]:
    return [belief.mean for belief in smooth(passages)]


def _matrices(params: KalmanParams, dt_s: float) -> tuple[Array, Array]:
    F, Q = discretise(params.order, dt_s, params.decay_s)
    return np.kron(F, np.eye(3)), np.kron(params.noise_density * Q, np.eye(3))
