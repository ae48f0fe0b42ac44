"""The simulation of a single taxel against geometry."""

from dataclasses import replace

import numpy as np
from data import SEED
from scipy.stats import ncx2

from pps_vision.experiments.baselines.single_taxel import Simulation, sample_paths
from pps_vision.experiments.pps_taxel import SIMULATIONS, simulated_ridge


def rng(k=0):
    return np.random.default_rng([SEED, k])


def test_as_many_objects_land_on_each_taxel_as_the_gaussian_says():
    n = 20000
    simulation = Simulation()
    share = sample_paths(replace(simulation, length_s=0.1), n, rng()).touched.mean(axis=0)
    off = np.hypot(*np.array(simulation.taxels_m).T) / simulation.landing_sigma_m
    expected = ncx2.cdf((simulation.touch_radius_m / simulation.landing_sigma_m) ** 2, 2, off**2)
    np.testing.assert_allclose(share, expected, atol=5 * np.sqrt(0.08 / n))


def test_objects_fly_straight_to_their_landing_points():
    simulation = Simulation()
    paths = sample_paths(simulation, 500, rng())
    d_m = paths.d_m[:, :, :1]
    moved = np.diff(d_m, axis=1)
    known = np.isfinite(moved)  # from the start of each path on
    np.testing.assert_allclose(moved[known], (simulation.step_s * paths.v_m_s[:, 1:])[known], atol=1e-12)
    assert known.mean() > 0.3
    speeds = np.linalg.norm(paths.v_m_s, axis=-1)
    assert simulation.speed_m_s[0] <= speeds.min() < speeds.max() <= simulation.speed_m_s[1]


def test_the_offset_shows_from_the_landing_point_only():
    exact, noisy, shifted = (simulated_ridge(simulation, "landing", 5, SEED) for simulation in SIMULATIONS.values())
    assert 0 <= exact["crosses_ttc_0_at_cm"][0] < 4
    assert -11.5 < shifted["crosses_ttc_0_at_cm"][0] < -8.5
    assert exact["ridge_width_cm"] < noisy["ridge_width_cm"] < shifted["ridge_width_cm"]
    assert simulated_ridge(SIMULATIONS["noisy, offset −10 cm"], "taxel", 5, SEED)["crosses_ttc_0_at_cm"][0] > 0
