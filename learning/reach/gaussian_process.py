"""Gaussian process regression: what we propose for the forward model (fewest samples for a given error)."""

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from pps_vision.types import Array

_LENGTH_BOUNDS, _NOISE_BOUNDS = (0.1, 10.0), (1e-10, 1.0)
_FIRST_NOISE = (1e-8, 1e-2)


class GaussianProcess:
    """One squared-exponential kernel for all outputs, a length scale an input and the share of noise in the variance,
    all three found by marginal likelihood on up to `n_tune` samples whenever the samples have doubled until then.
    Samples that come later extend the Cholesky factor by a block when they are first asked for."""

    def __init__(self, n_tune: int = 600) -> None:
        if n_tune < 2:
            raise ValueError(f"n_tune {n_tune}: expected at least two samples to tune on")
        self.n_tune, self._n_tuned = n_tune, 0
        nothing: Array = np.zeros((0, 0))
        self._x, self._y, self._L, self._weights, self._mean = nothing, nothing, nothing, nothing, nothing
        self.lengths: Array = np.ones(0)
        self.noise = 1e-8

    def update(self, x: Array, y: Array) -> None:
        """Learn x (N, inputs), y (N, outputs)."""
        self._x, self._y = (np.concatenate([b, a]) if len(b) else a for b, a in ((self._x, x), (self._y, y)))

    def predict(self, x: Array) -> Array:
        """(N, outputs); ValueError before the second sample."""
        self._catch_up()
        return self._kernel(x, self._x) @ self._weights + self._mean

    def jacobian(self, x: Array) -> Array:
        """(N, outputs, inputs) ∂y/∂x."""
        self._catch_up()
        k = self._kernel(x, self._x)
        at = np.stack([k @ (self._weights * column[:, None]) for column in self._x.T], axis=2)
        J: Array = (at - (k @ self._weights)[:, :, None] * x[:, None, :]) / self.lengths**2
        return J

    def _kernel(self, a: Array, b: Array) -> Array:
        a, b = a / self.lengths, b / self.lengths
        squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
        return np.asarray(np.exp(-0.5 * np.maximum(squared, 0.0)))

    def _catch_up(self) -> None:
        n, known = len(self._x), len(self._L)
        if n < 2:
            raise ValueError(f"{n} samples: expected at least two to learn from")
        if n == known:
            return
        if self._n_tuned < self.n_tune and n >= 2 * self._n_tuned:
            self._tune()
            known = 0
        new = self._kernel(self._x[known:], self._x[known:])
        new.flat[:: len(new) + 1] += self.noise
        L = np.zeros((n, n))
        L[:known, :known] = self._L[:known, :known]
        if known:
            across = solve_triangular(self._L, self._kernel(self._x[:known], self._x[known:]), lower=True)
            L[known:, :known] = across.T
            new -= across.T @ across
        L[known:, known:] = cholesky(new, lower=True, overwrite_a=True)
        self._L, self._mean = L, self._y.mean(axis=0)
        self._weights = cho_solve((L, True), self._y - self._mean)

    def _tune(self) -> None:
        """Length scales and noise of the greatest marginal likelihood, the scale of each output eliminated."""
        x, y = self._x[: self.n_tune], self._y[: self.n_tune] - self._y[: self.n_tune].mean(axis=0)

        def surprise(logs: Array) -> tuple[float, Array]:
            """Minus the logarithm of the likelihood, and its derivative by the logarithms."""
            self.lengths, self.noise = np.exp(logs[:-1]), float(np.exp(logs[-1]))
            K = self._kernel(x, x)
            try:
                L = cholesky(K + self.noise * np.eye(len(x)), lower=True, overwrite_a=True)
            except LinAlgError:
                return 1e12, np.zeros(len(logs))
            inverse = cho_solve((L, True), np.eye(len(x)))
            weights = inverse @ y
            variance = (y * weights).mean(axis=0) + 1e-300
            by_K = 0.5 * (y.shape[1] * inverse - (weights / variance) @ weights.T)
            by_r2 = by_K * K
            by_length = 2 * (by_r2.sum(axis=1) @ x**2 - np.einsum("ai,ab,bi->i", x, by_r2, x, optimize=True))
            value = y.shape[1] * np.log(np.diag(L)).sum() + 0.5 * len(x) * np.log(variance).sum()
            return float(value), np.append(by_length / self.lengths**2, self.noise * np.trace(by_K))

        lengths = np.log((2 * x.std(axis=0)).clip(*_LENGTH_BOUNDS))
        bounds = [*[tuple(np.log(_LENGTH_BOUNDS))] * x.shape[1], tuple(np.log(_NOISE_BOUNDS))]
        fits = [
            minimize(surprise, [*lengths, np.log(noise)], jac=True, bounds=bounds, options={"maxiter": 25})
            for noise in _FIRST_NOISE  # with much noise and with little: there is a best one on either side
        ]
        best = min(fits, key=lambda fit: float(fit.fun)).x
        self.lengths, self.noise = np.exp(best[:-1]), float(np.exp(best[-1]))
        self._n_tuned = len(self._x)
