"""Gaussian process regression with scikit-learn, for several outputs of comparable units."""

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from pps_vision.types import Array


class GaussianProcess:
    """One kernel for all outputs: squared exponential with a length scale per input, plus noise, by marginal likelihood
    on the first `n_tune` samples; fitted to all samples at the first prediction after an update."""

    def __init__(self, n_tune: int = 600) -> None:
        if n_tune < 2:
            raise ValueError(f"n_tune {n_tune}: expected at least two samples to tune on")
        self.n_tune = n_tune
        nothing: Array = np.zeros((0, 0))
        self._x, self._y, self._mean = nothing, nothing, nothing
        self._fitted: GaussianProcessRegressor | None = None

    def update(self, x: Array, y: Array) -> None:
        """Add samples x (N, inputs), y (N, outputs)."""
        self._x, self._y = (np.concatenate([b, a]) if len(b) else a for b, a in ((self._x, x), (self._y, y)))
        self._fitted = None

    def predict(self, x: Array) -> Array:
        """(N, outputs); ValueError before the second sample."""
        if self._fitted is None:
            self._fitted = self._fit()
        return np.asarray(self._fitted.predict(x)) + self._mean

    def _fit(self) -> GaussianProcessRegressor:
        n = len(self._x)
        if n < 2:
            raise ValueError(f"{n} samples: expected at least two to learn from")
        self._mean = self._y.mean(axis=0)
        x, y = self._x[: self.n_tune], (self._y - self._mean)[: self.n_tune]
        lengths = np.clip(2 * x.std(axis=0), 0.1, 10.0)
        kernel = ConstantKernel(1.0, (1e-3, 1e6)) * RBF(lengths, (0.1, 100.0)) + WhiteKernel(1e-6, (1e-12, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # an input without effect ends at the longest scale
            tuned = GaussianProcessRegressor(kernel, alpha=0.0).fit(x, y)
        if n <= self.n_tune:
            return tuned
        return GaussianProcessRegressor(tuned.kernel_, alpha=0.0, optimizer=None).fit(self._x, self._y - self._mean)
