"""The regression line of a map, against a numerical search and a map with a known offset."""

import numpy as np
import pytest
from data import SEED
from scipy.optimize import minimize

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.pps.ridges import FINE, bin_centers, offsets, orthogonal_line, ridge_width


def test_the_line_is_that_of_a_search_for_the_least_distance():
    rng = np.random.default_rng(SEED)
    y = rng.uniform(0, 3, 60)
    x = 0.4 + 0.3 * y + 0.1 * rng.standard_normal(60)
    weights = rng.uniform(0.1, 2.0, 60)

    def cost(line: np.ndarray) -> float:
        return float(weights @ ((x - line[0] - np.tan(line[1]) * y) * np.cos(line[1])) ** 2)

    best = minimize(cost, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    np.testing.assert_allclose(orthogonal_line(x, y, weights), [best[0], np.tan(best[1])], atol=1e-5)


def test_the_offset_of_objects_at_many_speeds():
    offset_m = 0.05
    rng = np.random.default_rng(SEED)
    left_s = np.tile(np.arange(0.025, 0.4, 0.05), 200)
    distance = offset_m + np.repeat(rng.uniform(0.05, 0.15, 200), 8) * left_s
    samples = (np.stack([distance, np.full(len(left_s), np.nan)], axis=1), np.stack([left_s, left_s], axis=1))
    memory = count_samples(empty_map(2, MemoryParams(ttc_range_s=(0.0, 0.4), bins=(60, 8))), *samples, np.ones(2, bool))
    estimates = offsets(memory)
    assert abs(estimates[0] - offset_m) < 0.003
    assert np.isnan(estimates[1])


def test_offset_and_width_of_worked_out_counts():
    """Bins of 0.1 m and 1 s from 0 m and 0.5 s: 0.05 m at 1 s and 0.15 m at 2 s; a ridge two bins wide."""
    counts = np.zeros((1, 3, 2, 2), np.int64)
    counts[0, [0, 1], [0, 1], 0] = 3
    assert offsets(PPSMemory(("a",), np.zeros(1, np.intp), counts, MemoryParams((0.0, 0.3), (0.5, 2.5), (3, 2)))) == (
        pytest.approx(-0.05)
    )
    ridge = np.zeros((*FINE.bins, 2))
    ridge[[60, 61], 10:50, 0] = 1
    assert ridge_width(ridge) == pytest.approx(np.std(bin_centers(FINE)[0][60:62, 0]))
