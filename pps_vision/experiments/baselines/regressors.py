"""Forward models arm → gaze from any regressor: LWPR, SciPy's and scikit-learn's."""

import warnings
from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.interpolate import RBFInterpolator
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neural_network import MLPRegressor

from learning.reach.babbling import crossing, gaze_at
from learning.reach.params import ArmLimits
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.types import Array

Predict = Callable[[Array], Array]


class Regressor(Protocol):
    """Learns y (N, outputs) from x (N, inputs), both of the order of 1, in batches of any size."""

    def update(self, x: Array, y: Array) -> None:
        """Learn more samples."""
        ...

    def predict(self, x: Array) -> Array:
        """Return y (N, outputs); NaN where there is no answer."""
        ...


class ArmToGaze:
    """Forward model arm posture → gaze posture that fixates the hand (J IV C).

    The regressor sees joint angles scaled to [−1, 1] by their limits, and the point where the lines of sight cross.
    """

    def __init__(self, regressor: Regressor) -> None:
        self.regressor, limits = regressor, ArmLimits()
        lower, upper = np.array(limits.lower_rad), np.array(limits.upper_rad)
        self.middle, self.half = (lower + upper) / 2, (upper - lower) / 2

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """Learn arm postures (N, 4) and gaze postures (N, 3), rad."""
        self.regressor.update((arm_rad - self.middle) / self.half, crossing(gaze_rad))

    def __call__(self, arm_rad: Array) -> Array:
        """Return gaze postures (N, 3) for arm postures (N, 4)."""
        return gaze_at(self.regressor.predict((arm_rad - self.middle) / self.half))


class LocalModels:
    """LWPR, which sees a sample at a time; NaN where no receptive field responds."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams, n_epochs: int = 1) -> None:
        """Show every batch `n_epochs` times, from the second time on in random order."""
        self.model, self.n_epochs = LWPR(n_inputs, n_outputs, params), n_epochs
        self._rng = np.random.default_rng(0)

    def update(self, x: Array, y: Array) -> None:
        """Learn more samples."""
        orders = [np.arange(len(x)), *(self._rng.permutation(len(x)) for _ in range(self.n_epochs - 1))]
        for k in np.concatenate(orders):
            self.model.update(x[k], y[k])

    def predict(self, x: Array) -> Array:
        """Return y (N, outputs)."""
        return self.model.predict(x)


class Refitted:
    """A regressor that is fitted anew to all samples with every batch."""

    def __init__(self, fit: Callable[[Array, Array], Predict]) -> None:
        self._fit = fit
        self._batches: list[tuple[Array, Array]] = []

    def update(self, x: Array, y: Array) -> None:
        """Learn more samples."""
        self._batches.append((x, y))
        all_x, all_y = (np.concatenate(parts) for parts in zip(*self._batches, strict=True))
        self.predict = self._fit(all_x, all_y)


def quintic_spline() -> Refitted:
    """Return SciPy's polyharmonic spline of degree 5 through all samples."""
    return Refitted(lambda x, y: RBFInterpolator(x, y, kernel="quintic"))


def gaussian_process(n_tune: int = 600) -> Refitted:
    """Return scikit-learn's process: squared exponential with a length scale per input, plus noise, for all outputs.

    The kernel is chosen by marginal likelihood on the first `n_tune` samples.
    """

    def fit(x: Array, y: Array) -> Predict:
        mean = y.mean(axis=0)
        lengths = np.clip(2 * x.std(axis=0), 0.1, 10.0)
        kernel = ConstantKernel(1.0, (1e-3, 1e6)) * RBF(lengths, (0.1, 100.0)) + WhiteKernel(1e-6, (1e-12, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # samples without noise end at the least noise
            tuned = GaussianProcessRegressor(kernel, alpha=0.0).fit(x[:n_tune], (y - mean)[:n_tune])
        model = GaussianProcessRegressor(tuned.kernel_, alpha=0.0, optimizer=None).fit(x, y - mean)
        return lambda at: np.asarray(model.predict(at)) + mean

    return Refitted(fit)


def network(seed: int) -> Refitted:
    """Return scikit-learn's network of two hidden layers of 64 tanh units, trained by L-BFGS."""

    def fit(x: Array, y: Array) -> Predict:
        scale = y.std(axis=0)
        model = MLPRegressor(
            hidden_layer_sizes=(64, 64), activation="tanh", solver="lbfgs", max_iter=2000, random_state=seed
        ).fit(x, y / scale)
        return lambda at: np.asarray(model.predict(at) * scale)

    return Refitted(fit)


def boosted_trees(seed: int) -> Refitted:
    """Return scikit-learn's histogram gradient-boosted trees, 300 for each output."""

    def fit(x: Array, y: Array) -> Predict:
        one = HistGradientBoostingRegressor(max_iter=300, early_stopping=False, random_state=seed)
        predict: Predict = MultiOutputRegressor(one).fit(x, y).predict
        return predict

    return Refitted(fit)
