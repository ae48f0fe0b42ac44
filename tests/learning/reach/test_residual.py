"""The process of a residual: what it learns, from what it refuses to learn, and its Jacobian."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF

from learning.reach import residual
from learning.reach.residual import _solved, _tuned, fit_residual

N = 500


def wave(x):
    return np.stack([np.sin(2 * x[:, 0]), np.cos(x[:, 1]) * x[:, 0], x[:, 1] ** 2 - 0.3], axis=1)


@pytest.fixture(scope="module")
def x():
    return np.random.default_rng(1).uniform(-1, 1, (N, 2))


@pytest.fixture(scope="module")
def learned(x):
    """A tenth of the samples is of something else."""
    rng = np.random.default_rng(2)
    y = wave(x) + 0.01 * rng.standard_normal((N, 3))
    y[rng.random(N) < 0.1] += 20 * rng.standard_normal(3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residual, "_N_TUNE", 150)  # for the time of the test
        return fit_residual(x, y, np.tile(np.eye(3), (N, 1, 1)))


def test_a_smooth_function_is_learned_from_samples_with_noise_and_outliers(learned):
    at = np.random.default_rng(3).uniform(-0.9, 0.9, (200, 2))
    assert np.sqrt(np.mean((learned(at)[0] - wave(at)) ** 2)) < 0.01


def test_its_slope_is_that_of_its_values(learned, x):
    value, J = learned(x[:20])
    for k, h in enumerate(1e-6 * np.eye(2)):
        np.testing.assert_allclose((learned(x[:20] + h)[0] - value) / 1e-6, J[:, :, k], atol=1e-4)


def test_noise_is_no_evidence_and_few_samples_are_not_enough(x):
    same = np.tile(np.eye(3), (N, 1, 1))
    for seed in range(3):
        assert fit_residual(x, np.random.default_rng(seed).standard_normal((N, 3)), same) is None
    assert fit_residual(x[:300], wave(x[:300]), same[:300]) is None


def test_what_holds_for_a_part_of_the_measurement_only_is_no_evidence(x):
    """The first half is bent one way, the second the other: what was learned from one makes the other worse."""
    turned = np.where(np.arange(N) < N / 2, 1.0, -1.0)[:, None] * wave(x)
    assert fit_residual(x, turned, np.tile(np.eye(3), (N, 1, 1))) is None


def test_a_solved_process_is_the_exact_one_and_what_is_left_of_a_block_is_predicted_by_the_others(x):
    """With all samples as inducing points: scikit-learn's regression with noise over precision on its diagonal."""
    rng = np.random.default_rng(4)
    x, y, precision, lengths = x[:60], wave(x[:60]), rng.uniform(0.2, 3.0, 60), np.array([0.7, 1.3])

    def predicted(some, at):
        process = GaussianProcessRegressor(RBF(lengths), alpha=0.05 / precision[some], optimizer=None)
        return process.fit(x[some], y[some]).predict(at)

    found, left = _solved(x, y, precision, lengths, 0.05, np.arange(60))
    np.testing.assert_allclose(found(x)[0], predicted(np.arange(60), x), atol=1e-5)
    for k in range(5):
        own = np.arange(12 * k, 12 * k + 12)
        np.testing.assert_allclose(left[own], y[own] - predicted(np.delete(np.arange(60), own), x[own]), atol=1e-5)


def test_the_kernel_is_tuned_to_what_samples_were_drawn_from_and_not_to_outliers(x):
    """Lengths 0.4 and 1.5, noise 0.01 of the variance; a fifth is of something else."""
    rng, lengths, x = np.random.default_rng(5), np.array([0.4, 1.5]), x[:250]
    cov = np.exp(-0.5 * np.sum(((x[:, None] - x) / lengths) ** 2, axis=2)) + 0.01 * np.eye(250)
    y = np.linalg.cholesky(cov) @ rng.standard_normal((250, 3))
    wrong = np.arange(250) % 5 == 0
    y[wrong] += 5 * rng.standard_normal((50, 3))
    found, noise = _tuned(x, y, np.where(wrong, 0.3, 0.9))
    np.testing.assert_allclose(found, lengths, rtol=0.25)
    assert 0.005 < noise < 0.02


def test_samples_count_by_the_precision_with_which_angles_tell_of_them():
    """Half of the samples are seen from so near that an angle's noise is a hundredth of the others' in space."""
    rng = np.random.default_rng(6)
    x = rng.uniform(-1, 1, (N, 2))
    scale = np.where(np.arange(N) % 2, 10.0, 0.1)[:, None]
    y = wave(x) + 0.05 * scale * rng.standard_normal((N, 3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residual, "_N_TUNE", 150)
        learned = fit_residual(x, y, np.eye(3) / scale[:, :, None])
    at = rng.uniform(-0.9, 0.9, (200, 2))
    assert np.sqrt(np.mean((learned(at)[0] - wave(at)) ** 2)) < 0.004
