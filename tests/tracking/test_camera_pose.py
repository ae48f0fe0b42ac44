"""The delay of joints that are exact or late, against sums over a grid of delays."""

import numpy as np
import pytest

from tracking.camera_pose import exact_or_late

PRIOR_S = 0.02


@pytest.mark.parametrize("measured_s", [0.0, 0.001, 0.004, 0.010, -0.020])
@pytest.mark.parametrize("noise_s", [0.0005, 0.002, 0.01])
def test_mean_and_spread_are_those_of_the_posterior(measured_s: float, noise_s: float) -> None:
    tau = np.linspace(-0.15, 0.15, 30001)
    step = tau[1] - tau[0]
    prior = np.exp(-0.5 * (tau / PRIOR_S) ** 2) / (np.sqrt(2 * np.pi) * PRIOR_S) * step
    prior[len(tau) // 2] += 1.0  # exact joints are as likely as late ones
    posterior = prior * np.exp(-0.5 * ((measured_s - tau) / noise_s) ** 2)
    posterior /= posterior.sum()
    mean = posterior @ tau
    std = np.sqrt(posterior @ (tau - mean) ** 2)
    var = 1 / (noise_s**-2 + PRIOR_S**-2)  # of late joints alone
    found = exact_or_late(measured_s * var / noise_s**2, var, PRIOR_S)
    assert found == pytest.approx((mean, std), rel=2e-3, abs=2e-6)
