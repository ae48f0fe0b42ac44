"""Every regressor on one smooth function, in one batch and in many; what is special about each."""

import numpy as np
import pytest

from learning.reach.gaussian_process import GaussianProcess
from pps_vision.experiments.baselines.lwpr import LWPRParams
from pps_vision.experiments.baselines.regressors import LocalModels, boosted_trees, network, quintic_spline


def smooth(x):
    return np.stack([np.sin(2 * x[:, 0]) * x[:, 1], np.cos(x[:, 0] + x[:, 1])], axis=1)


MAKERS = {
    "LWPR": (lambda: LocalModels(2, 2, LWPRParams(init_D=20)), 0.1),
    "Gaussian process": (lambda: GaussianProcess(n_tune=100), 1e-3),
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


@pytest.mark.parametrize("name", ["LWPR", "quintic spline"])
def test_batches_do_not_matter(rng, name):
    x, test = rng.uniform(-1, 1, (120, 2)), rng.uniform(-1, 1, (20, 2))
    whole, parts = MAKERS[name][0](), MAKERS[name][0]()
    whole.update(x, smooth(x))
    for part in np.split(x, 6):
        parts.update(part, smooth(part))
        parts.predict(test)
    np.testing.assert_allclose(parts.predict(test), whole.predict(test), atol=1e-6)


def test_the_process_extends_its_factor_exactly(rng):
    """Samples that come after it was tuned give what they would have given at once."""
    x, test = rng.uniform(-1, 1, (300, 2)), rng.uniform(-1, 1, (20, 2))
    parts, whole = GaussianProcess(n_tune=100), GaussianProcess(n_tune=100)
    parts.update(x[:100], smooth(x[:100]))
    parts.predict(test)
    parts.update(x[100:], smooth(x[100:]))
    whole.update(x, smooth(x))
    np.testing.assert_allclose(parts.predict(test), whole.predict(test), atol=1e-5)


def test_the_process_finds_the_noise(rng):
    x = rng.uniform(-1, 1, (200, 2))
    process = GaussianProcess(n_tune=200)
    y = smooth(x)
    process.update(x, y + 0.1 * rng.standard_normal(y.shape))
    rmse = np.sqrt(np.mean((process.predict(x) - y) ** 2))
    assert 1e-4 < process.noise < 1
    assert rmse < 0.06


def test_the_jacobian_is_the_derivative(rng):
    x, test = rng.uniform(-1, 1, (200, 2)), rng.uniform(-0.9, 0.9, (10, 2))
    process = GaussianProcess(n_tune=100)
    process.update(x, smooth(x))
    h = 1e-5
    numeric = np.stack(
        [(process.predict(test + h * e) - process.predict(test - h * e)) / (2 * h) for e in np.eye(2)], 2
    )
    np.testing.assert_allclose(process.jacobian(test), numeric, atol=1e-5)


def test_bad_input_is_named():
    process = GaussianProcess()
    process.update(np.zeros((1, 2)), np.zeros((1, 1)))
    with pytest.raises(ValueError, match="1 samples: expected at least two"):
        process.predict(np.zeros((1, 2)))
    with pytest.raises(ValueError, match="n_tune 1"):
        GaussianProcess(n_tune=1)
