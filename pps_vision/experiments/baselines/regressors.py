"""Forward models arm → gaze from general regressors: LWPR, SciPy's and scikit-learn's."""

import warnings
from collections.abc import Callable

import numpy as np
from scipy.interpolate import RBFInterpolator
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from learning.reach.params import ArmLimits
from pps_vision.experiments.babbling import crossing, gaze_at
from pps_vision.experiments.baselines.lwpr import LWPR
from pps_vision.experiments.baselines.revolute_arm import RevoluteArm
from pps_vision.types import Array

_N_TUNE = 600  # samples by which the kernel of the Gaussian process is chosen

Predict = Callable[[Array], Array]


class Refitted:
    """A regressor that is fitted to all samples again after each batch."""

    def __init__(self, fit: Callable[[Array, Array], Predict]) -> None:
        self._fit = fit
        self._batches: list[tuple[Array, Array]] = []

    def update(self, x: Array, y: Array) -> None:
        """Learn more samples."""
        self._batches.append((x, y))
        all_x, all_y = (np.concatenate(arrays) for arrays in zip(*self._batches, strict=True))
        self.predict = self._fit(all_x, all_y)


class ArmToGaze:
    """Forward model from arm posture to the gaze posture that fixates the hand (J IV C).

    The regressor maps joint angles, scaled to [−1, 1] by their limits, to the point where the lines of sight cross.
    """

    def __init__(self, regressor: LWPR | Refitted) -> None:
        limits = ArmLimits()
        self.regressor = regressor
        self.middle = (np.array(limits.lower_rad) + np.array(limits.upper_rad)) / 2
        self.half = np.array(limits.upper_rad) - self.middle

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """Learn arm postures (N, 4) and gaze postures (N, 3), rad."""
        self.regressor.update((arm_rad - self.middle) / self.half, crossing(gaze_rad))

    def __call__(self, arm_rad: Array) -> Array:
        """Return gaze postures (N, 3) for arm postures (N, 4)."""
        return gaze_at(self.regressor.predict((arm_rad - self.middle) / self.half))


ForwardModel = RevoluteArm | ArmToGaze  # arm (N, 4) → gaze (N, 3), learned from samples


def quintic_spline() -> Refitted:
    """Return SciPy's polyharmonic spline of degree 5 through all samples."""
    return Refitted(lambda x, y: RBFInterpolator(x, y, kernel="quintic"))


def gaussian_process() -> Refitted:
    """Return scikit-learn's Gaussian process: squared exponential with a length scale per input, plus noise.

    The kernel is chosen by the marginal likelihood of the first 600 samples.
    """

    def fit(x: Array, y: Array) -> Predict:
        mean = y.mean(axis=0)
        lengths = np.clip(2 * x.std(axis=0), 0.1, 10.0)
        kernel = ConstantKernel(1.0, (1e-3, 1e6)) * RBF(lengths, (0.1, 100.0)) + WhiteKernel(1e-6, (1e-12, 1.0))
        with warnings.catch_warnings():
            # noise-free samples end at the lower bound of the noise
            warnings.simplefilter("ignore", ConvergenceWarning)
            tuned = GaussianProcessRegressor(kernel, alpha=0.0).fit(x[:_N_TUNE], (y - mean)[:_N_TUNE])
        model = GaussianProcessRegressor(tuned.kernel_, alpha=0.0, optimizer=None).fit(x, y - mean)
        return lambda queries: np.asarray(model.predict(queries)) + mean

    return Refitted(fit)
