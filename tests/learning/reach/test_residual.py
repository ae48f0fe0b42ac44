"""The process of a residual: its accuracy, its evidence and its Jacobian."""

import numpy as np
import pytest

from learning.reach import residual
from learning.reach.residual import fit_residual

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
    identity = np.tile(np.eye(3), (N, 1, 1))
    for seed in range(3):
        assert fit_residual(x, np.random.default_rng(seed).standard_normal((N, 3)), identity) is None
    assert fit_residual(x[:300], wave(x[:300]), identity[:300]) is None


def test_what_holds_for_a_part_of_the_measurement_only_is_no_evidence(x):
    """The first half is bent one way, the second the other: a process of one predicts the other worse than 0."""
    turned = np.where(np.arange(N) < N / 2, 1.0, -1.0)[:, None] * wave(x)
    assert fit_residual(x, turned, np.tile(np.eye(3), (N, 1, 1))) is None


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
