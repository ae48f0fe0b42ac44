"""What the choices R leaves open cost."""

import numpy as np
import pytest
from data import SEED

from learning.memory import MemoryParams
from learning.single_taxel import Shower, contact_probability, map_error, rain
from pps_vision.experiments.pps.hyper_parameters import OBJECTS, base_rate_error, coarser, recommend


def test_counts_summed_up_are_those_learned_in_coarser_bins():
    fine, coarse = (
        rain(Shower(), 300, np.random.default_rng(SEED), MemoryParams(bins=bins)) for bins in ((96, 48), (8, 4))
    )
    summed = coarser(fine, (8, 4), 1.0)
    np.testing.assert_array_equal(summed.counts, coarse.counts)
    assert summed.params == coarse.params


def test_bins_that_do_not_divide_are_refused():
    memory = rain(Shower(), 1, np.random.default_rng(SEED), MemoryParams())
    with pytest.raises(ValueError, match="3×4 bins: expected divisors of 8×4"):
        coarser(memory, (3, 4), 1.0)


def test_near_misses_and_half_the_window_bring_the_map_nearer_to_the_truth():
    rng = np.random.default_rng(SEED)
    truth = contact_probability(Shower(), 10000, rng)
    touches, near, half = (
        map_error(rain(Shower(), 1000, rng, MemoryParams(sigma_bins=sigma), near_misses=n), truth)
        for n, sigma in ((False, 1.0), (True, 1.0), (True, 0.5))
    )
    rate = base_rate_error(truth)
    print(f"error: touches only {touches:.3f}, near misses {near:.3f}, half the window {half:.3f}, base rate {rate}")
    assert half < 0.85 * near < near < rate < 0.5 * touches


def test_the_fewest_bins_that_nearly_reach_the_best_are_recommended():
    n = len(OBJECTS)
    errors = {"8×4": {"1": [0.10] * n, "0.5": [0.055] * n}, "16×8": {"1": [0.06] * n}, "32×16": {"1": [0.05] * n}}
    found = recommend(errors)[str(OBJECTS[0])]
    assert found["best"] == {"bins": "32×16", "sigma_bins": 1.0, "error": 0.05}
    assert found["cheapest_within_10_percent"] == {"bins": "8×4", "sigma_bins": 0.5, "error": 0.055}
    assert found["default_error"] == 0.10
