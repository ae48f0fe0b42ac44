"""Gaussian process of the residual of a structured model, kept only if it predicts held-out blocks better than 0.

scikit-learn tunes the kernel on few samples; the process is then solved on inducing points (subset of regressors),
f(x) = k(x, Z) α with (Σ p k(Z, x) k(x, Z) + σ² k(Z, Z)) α = Σ p k(Z, x) y, which weighs samples by their precision p.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from pps_vision.types import Array

_LEAST_SAMPLES = 400  # fewer leave nothing beside the 247 unknowns of a structure
_N_TUNE = 400
_N_INDUCING = 1500  # the cost of learning, a few seconds; `bench reach_kinematics` measures the result
_FIRST_NOISE = 0.1  # over the variance, before tuning
_BLOCKS = 5  # blocks of consecutive samples, each held out once
_MOST_STEPS = 40  # tuning steps; without a signal tuning would go on for long
_LEAST_LOG = -60.0  # least exponent of the kernel: subnormal numbers take a hundred times as long
_ROUNDING = 1e-11  # added to the diagonal, of its mean


@dataclass(frozen=True)
class Residual:
    """A smooth function of x (N, k): f(x) = Σ exp(−½|(x − z)/`lengths`|²) α over the m points z."""

    lengths: Array  # (k,) length scales
    points: Array  # (m, k) z over `lengths`
    weights: Array  # (m, 3) α

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Values (N, 3) at x (N, k), and Jacobians (N, 3, k)."""
        scaled = x / self.lengths
        m, k = self.points.shape
        K = _kernel(scaled, self.points)
        moments = np.concatenate([self.weights[:, None], self.points[:, :, None] * self.weights[:, None]], axis=1)
        value, *pulls = np.moveaxis((K @ moments.reshape(m, -1)).reshape(len(x), k + 1, 3), 1, 0)
        slopes = [(pull - scaled[:, j, None] * value) / self.lengths[j] for j, pull in enumerate(pulls)]
        return value, np.stack(slopes, axis=2)


def _kernel(x: Array, z: Array) -> Array:
    """(N, m) exp(−½|x − z|²)."""
    away = x @ z.T
    away -= 0.5 * (x**2).sum(axis=1)[:, None]
    away -= 0.5 * (z**2).sum(axis=1)
    return np.exp(np.clip(away, _LEAST_LOG, 0.0, out=away), out=away)


def fit_residual(x: Array, y: Array, G: Array) -> Residual | None:
    """The process of y (N, 3) over x (N, k) in the order of their measurement, or None without evidence for it.

    G (N, 3, 3) maps an error of y to the measured angles, in which the noise is; samples with large errors count for
    little (Geman–McClure).  The evidence: each of five blocks is predicted better by the process of the others than
    by 0, in the median; with a broad kernel before the tuning, which takes most of the time, and after.
    """
    if len(x) < _LEAST_SAMPLES:
        return None
    off_by_0 = _angles(G, y)
    spread = 1 / np.sum(np.linalg.inv(G) ** 2, axis=(1, 2))
    lengths = x.std(axis=0)
    noise = _FIRST_NOISE
    off = off_by_0
    for tuned in (False, True):
        inlier = 1 / (1 + (off / (4 * np.median(off))) ** 2)
        precision = inlier**2 * spread
        precision /= np.median(precision)
        if tuned:
            lengths, noise = _tuned(x, y / np.sqrt(np.average(y**2, axis=0, weights=precision).mean()), inlier)
        process, held_out = _solved(x, y, precision, lengths, noise, np.argsort(-inlier, kind="stable")[:_N_INDUCING])
        off = _angles(G, held_out)
        if not all(np.median(off[block]) < np.median(off_by_0[block]) for block in _blocks(len(x))):
            return None
    return process


def _angles(G: Array, y: Array) -> Array:
    """(N,) |G y|."""
    return np.linalg.norm((G @ y[..., None])[..., 0], axis=1)


def _blocks(n: int) -> list[NDArray[np.intp]]:
    return np.array_split(np.arange(n), _BLOCKS)


def _solved(
    x: Array, y: Array, precision: Array, lengths: Array, noise: float, inducing: NDArray[np.intp]
) -> tuple[Residual, Array]:
    """The process of all samples, and residuals (N, 3) of each block by that of the others; `noise`: σ²/variance."""
    scaled = x / lengths
    points = scaled[inducing]
    K = _kernel(scaled, points)
    blocks = _blocks(len(x))
    A = [(K[block].T * precision[block]) @ K[block] for block in blocks]
    b = [(K[block].T * precision[block]) @ y[block] for block in blocks]
    A_all = sum(A, start=noise * _kernel(points, points))
    b_all = np.sum(b, axis=0)
    held_out = y.copy()
    for block, A_own, b_own in zip(blocks, A, b, strict=True):
        held_out[block] -= K[block] @ _solve(A_all - A_own, b_all - b_own)
    return Residual(lengths, points, _solve(A_all, b_all)), held_out


def _solve(A: Array, b: Array) -> Array:
    return cho_solve(cho_factor(A + _ROUNDING * np.trace(A) * np.eye(len(A)) / len(A)), b)


def _tuned(x: Array, y: Array, inlier: Array) -> tuple[Array, float]:
    """Length scales (k,) and noise over variance, of greatest marginal likelihood on the first inliers."""
    inliers = np.flatnonzero(inlier > 0.5)[:_N_TUNE]
    spans = x.std(axis=0)
    lengths = RBF(spans, [(0.2 * span, 20 * span) for span in spans])
    kernel = ConstantKernel(1.0, (1e-3, 1e4)) * lengths + WhiteKernel(1e-3, (1e-9, 2.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # samples without noise end at the least noise
        process = GaussianProcessRegressor(kernel, alpha=1e-12, optimizer=_few_steps)
        tuned = process.fit(x[inliers], y[inliers]).kernel_
    return np.asarray(tuned.k1.k2.length_scale), tuned.k2.noise_level / tuned.k1.k1.constant_value


def _few_steps(cost: Callable[[Array], tuple[float, Array]], start: Array, bounds: Array) -> tuple[Array, float]:
    """scikit-learn's own optimiser with few steps."""
    result = minimize(cost, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"maxiter": _MOST_STEPS})
    return result.x, result.fun
