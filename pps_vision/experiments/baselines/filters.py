"""Baselines of the Kalman filter: OpenCV's and filterpy's, with our filter's model.

Each is made for the parameters and the first belief, and then takes one measurement at a time. As in an application,
the matrices are computed only where the time step changes.
"""

from typing import Protocol

import cv2
import numpy as np
from filterpy.kalman import KalmanFilter

from pps_vision.types import Array
from tracking.kalman import Belief, KalmanParams, discretise


class Filter(Protocol):
    """Takes measurements in the order of their stamps."""

    def step(self, stamp_s: float, position: Array, cov: Array) -> Array:
        """Return the state (order, 3): position, velocity, …"""
        ...


class _Matrices:
    """Transition and process noise (3·order, 3·order) of our model for the step to the next stamp."""

    def __init__(self, params: KalmanParams, stamp_s: float) -> None:
        self.params, self.stamp_s, self.dt_s = params, stamp_s, np.nan

    def advance(self, stamp_s: float) -> tuple[Array, Array] | None:
        """Return the matrices; None where they are the last step's."""
        dt, self.stamp_s = stamp_s - self.stamp_s, stamp_s
        if abs(dt - self.dt_s) <= 1e-6:
            return None
        self.dt_s = dt
        A, Q = discretise(self.params.order, dt, self.params.decay_s)
        return np.kron(A, np.eye(3)), np.kron(self.params.noise_density * Q, np.eye(3))


class OpenCVFilter:
    """cv2.KalmanFilter."""

    def __init__(self, params: KalmanParams, first: Belief) -> None:
        n = first.mean.size
        self.kf = cv2.KalmanFilter(n, 3, 0, cv2.CV_64F)
        self.kf.measurementMatrix = np.eye(3, n)
        self.kf.statePost, self.kf.errorCovPost = (
            first.mean.reshape(n, 1).copy(),
            first.cov.copy(),
        )  # it writes into them
        self.params, self.matrices = params, _Matrices(params, first.stamp_s)

    def step(self, stamp_s: float, position: Array, cov: Array) -> Array:
        """Predict and update."""
        if changed := self.matrices.advance(stamp_s):
            self.kf.transitionMatrix, self.kf.processNoiseCov = changed
        self.kf.measurementNoiseCov = self.params.white_share * cov
        self.kf.predict()
        return np.asarray(self.kf.correct(position.reshape(3, 1)), dtype=float).reshape(-1, 3)


class FilterPyFilter:
    """filterpy's KalmanFilter."""

    def __init__(self, params: KalmanParams, first: Belief) -> None:
        n = first.mean.size
        self.kf = KalmanFilter(dim_x=n, dim_z=3)
        self.kf.H, self.kf.x, self.kf.P = np.eye(3, n), first.mean.reshape(n, 1), first.cov.copy()
        self.params, self.matrices = params, _Matrices(params, first.stamp_s)

    def step(self, stamp_s: float, position: Array, cov: Array) -> Array:
        """Predict and update."""
        if changed := self.matrices.advance(stamp_s):
            self.kf.F, self.kf.Q = changed
        self.kf.predict()
        self.kf.update(position.reshape(3, 1), R=self.params.white_share * cov)
        return np.asarray(self.kf.x, dtype=float).reshape(-1, 3)
