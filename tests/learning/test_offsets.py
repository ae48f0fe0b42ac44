"""Offsets from orthogonal regression, against a search for the least distance and a map whose offset is known."""

import numpy as np
import pytest
from data import SEED
from scipy.optimize import minimize

from learning.memory import MemoryParams, PPSMemory, count_samples
from learning.offsets import offsets, orthogonal_line, seen_aside


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
    [([0.0, 1.0], [1.0, 1.0], [1, 1]), ([0.0, 1.0], [0.0, 1.0], [0, 0]), ([1.0, 1.0], [2.0, 2.0], [1, 1])],
    ids=["along x", "nothing counts", "one point"],
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


def test_where_touches_were_seen_tells_what_is_seen_aside():
    """Balls of two sizes lie on a plane's taxels; all are seen 2, −3, 1 cm aside, one of them wildly wrong, one
    never, and one touches nothing."""
    rng = np.random.default_rng(SEED)
    taxels = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])
    touched = np.eye(3, dtype=bool)[rng.integers(0, 3, 60)]
    radius = rng.choice([0.02, 0.035], 60)
    seen = touched @ taxels + radius[:, None] * [0, 0, 1] + [0.02, -0.03, 0.01] + rng.normal(0, 0.002, (60, 3))
    seen[0] += 1.0
    seen[1] = np.nan
    seen[2], touched[2] = [1.0, 1.0, 1.0], False
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    np.testing.assert_allclose(seen_aside(seen, taxels, normals, touched, radius), [0.02, -0.03, 0.01], atol=2e-3)
    one = seen_aside(seen[3:4], taxels, normals, touched[3:4], radius[3:4])
    np.testing.assert_allclose(one, [0.01, -0.015, 0.005], atol=4e-3, err_msg="one touch is half believed")
    np.testing.assert_array_equal(seen_aside(seen[1:3], taxels, normals, touched[1:3], radius[1:3]), 0)
