"""Offsets from orthogonal regression, against a search for the least distance and a map whose offset is known."""

import numpy as np
import pytest
from data import SEED
from scipy.optimize import minimize

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from pps_vision.experiments.pps.taxel_offsets import offsets, orthogonal_line


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def test_the_line_is_the_one_a_search_finds(rng: np.random.Generator) -> None:
    y = rng.uniform(0, 3, 60)
    x = 0.4 + 0.3 * y + 0.1 * rng.standard_normal(60)
    weights = rng.uniform(0.1, 2.0, 60)

    def cost(line: np.ndarray) -> float:
        across = (x - line[0] - np.tan(line[1]) * y) * np.cos(line[1])
        return float(weights @ across**2)

    best = minimize(cost, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    line = orthogonal_line(x, y, weights)
    assert line is not None
    np.testing.assert_allclose([line.offset, line.slope], [best[0], np.tan(best[1])], atol=1e-5)


def test_points_of_no_weight_do_not_count() -> None:
    line = orthogonal_line([0.03, 0.13, 9.0], [0.0, 1.0, 0.5], [1, 1, 0])
    assert line is not None
    np.testing.assert_allclose([line.offset, line.slope], [0.03, 0.1])


@pytest.mark.parametrize(
    ("x", "y", "weights"),
    [
        ([0.0, 1.0], [1.0, 1.0], [1, 1]),
        ([0.0, 1.0], [0.0, 1.0], [0, 0]),
        ([1.0, 1.0], [2.0, 2.0], [1, 1]),
        ([0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0], [1, 1, 1, 1]),
    ],
    ids=["along x", "nothing counts", "one point", "a square"],
)
def test_where_no_line_crosses_there_is_none(x: list[float], y: list[float], weights: list[float]) -> None:
    assert orthogonal_line(x, y, weights) is None


@pytest.mark.parametrize("weights", [[1.0], [1.0, -1.0]])
def test_weights_that_do_not_fit_the_points_are_refused(weights: list[float]) -> None:
    with pytest.raises(ValueError, match="as many of each"):
        orthogonal_line([0.0, 1.0], [0.0, 1.0], weights)


@pytest.mark.parametrize("offset_m", [-0.03, 0.0, 0.02, 0.05])
def test_the_offset_of_what_comes_at_many_speeds_is_found(offset_m: float, rng: np.random.Generator) -> None:
    left_s = np.tile(np.arange(0.025, 0.4, 0.05), 200)
    speed = np.repeat(rng.uniform(0.05, 0.15, 200), 8)
    params = MemoryParams(ttc_range_s=(0.0, 0.4), bins=(60, 8))
    blank = PPSMemory(("a", "b"), np.zeros(2, np.intp), np.zeros((2, 60, 8, 2), np.int64), params)
    distance = np.stack([offset_m + speed * left_s, np.full(len(left_s), np.nan)], axis=1)
    memory = count_samples(blank, distance, np.stack([left_s, left_s], axis=1), np.array([True, True]))
    found = offsets(memory)
    assert abs(found[0] - offset_m) < 0.003
    assert np.isnan(found[1])


def test_the_line_of_a_map_is_that_of_the_centres_of_its_bins() -> None:
    """Bins of 0.1 m and 1 s from 0 m and 0.5 s: 0.05 m at 1 s and 0.15 m at 2 s, or 0.25 m by other weights."""
    counts = np.zeros((1, 3, 2, 2), np.int64)
    counts[0, [0, 1], [0, 1], 0] = 3
    memory = PPSMemory(("a",), np.zeros(1, np.intp), counts, MemoryParams((0.0, 0.3), (0.5, 2.5), (3, 2)))
    assert offsets(memory) == pytest.approx(-0.05)
    weights = np.zeros((1, 3, 2))
    weights[0, [0, 2], [0, 1]] = 0.5
    assert offsets(memory, weights) == pytest.approx(-0.15)
