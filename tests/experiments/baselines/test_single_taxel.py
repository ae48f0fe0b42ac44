"""The simulation of a single taxel against geometry and quadrature."""

from dataclasses import replace

import numpy as np
from data import SEED
from scipy.stats import ncx2

from learning.pps.memory import MemoryParams
from learning.pps.receptive_field import ReceptiveField
from pps_vision.experiments.baselines.single_taxel import Simulation, count_paths, empty_map, from_taxel, sample_paths


def rng(k=0):
    return np.random.default_rng([SEED, k])


def test_as_many_objects_land_on_each_taxel_as_the_gaussian_says():
    n = 20000
    simulation = Simulation()
    share = sample_paths(replace(simulation, length_s=0.1), n, rng()).touched.mean(axis=0)
    off = np.hypot(*np.array(simulation.taxels_m).T) / simulation.landing_sigma_m
    expected = ncx2.cdf((simulation.touch_radius_m / simulation.landing_sigma_m) ** 2, 2, off**2)
    np.testing.assert_allclose(share, expected, atol=5 * np.sqrt(0.08 / n))


def test_the_maps_frequencies_agree_with_quadrature():
    """All objects start at one point of the normal, so that the landing radius, the speed and the time
    are all there is; integrated over, bin by bin."""
    s = 0.28
    field = ReceptiveField()
    simulation = Simulation(start_distance_m=(s, s), start_half_angle_rad=0.0, taxels_m=((0.0, 0.0),))
    r, speed, tau = (
        (np.arange(n) + 0.5) / n * (high - low) + low for n, low, high in ((400, 0, 0.3), (60, 0.05, 0.15), (300, 0, 3))
    )
    r = r[:, None, None]
    speed = speed[:, None]
    length = np.hypot(s, r)
    to_go = tau * speed / length
    aside = r * (1 - to_go)
    height = s * to_go
    D = np.hypot(aside, height)
    TTC = D**2 * length / (height * s - aside * r) / speed
    inside = (to_go <= 1) & (D < 0.2) & (TTC >= 0) & (TTC < 3)
    inside &= aside <= field.base_radius_m + height * np.tan(field.half_angle_rad)
    weight = np.broadcast_to(r * np.exp(-0.5 * (r / simulation.landing_sigma_m) ** 2), D.shape)
    expected = np.zeros((2, 8, 4))
    D_bin = ((D + 0.1) / 0.3 * 8).astype(int)
    TTC_bin = (np.where(inside, TTC, 0) / 3 * 4).astype(int)
    hit = np.broadcast_to(r <= simulation.touch_radius_m, D.shape)
    np.add.at(expected, (np.where(hit, 0, 1)[inside], D_bin[inside], TTC_bin[inside]), weight[inside])
    paths = sample_paths(simulation, 20000, rng(5))
    D, TTC = (np.repeat(samples, 2, axis=2) for samples in from_taxel(paths.d_m, paths.v_m_s, field))
    touched = np.concatenate([paths.touched, ~paths.touched], axis=1)  # the second taxel makes every object count
    counts = count_paths(empty_map(2, MemoryParams()), D, TTC, touched).counts[0]
    total = counts.sum(axis=-1)
    counted = total > 3000
    assert counted.sum() >= 8
    chance = expected[0] / np.maximum(expected.sum(axis=0), 1e-12)
    assert np.ptp(chance[counted]) > 0.15
    np.testing.assert_allclose((counts[..., 0] / np.maximum(total, 1))[counted], chance[counted], atol=0.03)
    np.testing.assert_allclose(total / total.sum(), expected.sum(axis=0) / expected.sum(), atol=0.01)
