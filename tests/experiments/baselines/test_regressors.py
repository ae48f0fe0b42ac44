"""Every regressor on one smooth function, in one batch and in many; what is special about each."""

import numpy as np
import pytest

from learning.reach.babbling import Babbled, babble
from pps_vision.experiments.baselines.lwpr import LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.baselines.regressors import (
    ArmToGaze,
    LocalModels,
    boosted_trees,
    gaussian_process,
    network,
    quintic_spline,
)
from pps_vision.experiments.reach.map_truth import gaze_rmse_deg
from pps_vision.robot.icub import load_icub


def smooth(x):
    return np.stack([np.sin(2 * x[:, 0]) * x[:, 1], np.cos(x[:, 0] + x[:, 1])], axis=1)


MAKERS = {
    "LWPR": (lambda: LocalModels(2, 2, LWPRParams(init_D=20)), 0.1),
    "Gaussian process": (lambda: gaussian_process(n_tune=100), 1e-3),
    "quintic spline": (quintic_spline, 1e-3),
    "network": (lambda: network(0), 0.02),
    "boosted trees": (lambda: boosted_trees(0), 0.15),
}


@pytest.fixture
def rng():
    return np.random.default_rng(2)


@pytest.mark.parametrize("name", MAKERS)
def test_learns_a_smooth_function(rng, name):
    make, tolerance = MAKERS[name]
    x, test = rng.uniform(-1, 1, (600, 2)), rng.uniform(-0.95, 0.95, (200, 2))
    regressor = make()
    for part in np.split(x, 3):
        regressor.update(part, smooth(part))
    rmse = np.sqrt(np.mean((regressor.predict(test) - smooth(test)) ** 2))
    assert rmse < tolerance


@pytest.mark.parametrize("name", ["LWPR", "Gaussian process", "quintic spline"])
def test_batches_do_not_matter(rng, name):
    x, test = rng.uniform(-1, 1, (120, 2)), rng.uniform(-1, 1, (20, 2))
    whole, parts = MAKERS[name][0](), MAKERS[name][0]()
    whole.update(x, smooth(x))
    for part in np.split(x, 6):
        parts.update(part, smooth(part))
        parts.predict(test)
    np.testing.assert_allclose(parts.predict(test), whole.predict(test), atol=1e-6)


def test_the_process_finds_the_noise(rng):
    x = rng.uniform(-1, 1, (200, 2))
    process = gaussian_process(n_tune=200)
    y = smooth(x)
    process.update(x, y + 0.1 * rng.standard_normal(y.shape))
    rmse = np.sqrt(np.mean((process.predict(x) - y) ** 2))
    assert rmse < 0.06


def test_arm_to_gaze_learns_the_forward_model():
    """The paper's LWPR came to 0.84° with 4400 samples."""
    babbled = babble(load_icub(), "right", 6000, np.random.default_rng(1))
    n = 1200
    test = Babbled(babbled.arm_rad[n:], babbled.gaze_rad[n:], 0)
    process = ArmToGaze(gaussian_process(n_tune=200))
    local = ArmToGaze(LocalModels(4, 3, LWPRParams(init_D=10, w_gen=0.2, metric=MetricParams(rate=0))))
    for model in (process, local):
        model.learn(babbled.arm_rad[:n], babbled.gaze_rad[:n])
    errors = gaze_rmse_deg(process, test)[0], gaze_rmse_deg(local, test)[0]
    print(f"after {n} samples: process {errors[0]:.3f}°, LWPR {errors[1]:.2f}°")
    assert errors[0] < 0.15
    assert errors[1] < 3
