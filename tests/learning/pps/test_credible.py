"""Credible intervals: against exact Beta quantiles, and by how often they cover what the map settles on."""

import numpy as np
import pytest
from data import SEED
from scipy.stats import beta

from learning.pps.credible import activation_interval
from learning.pps.memory import MemoryParams, PPSMemory, activation

ONE_CELL = MemoryParams(bins=(1, 1))


def memory_of(positive, negative, params=ONE_CELL):
    counts = np.zeros((1, *params.bins, 2), np.int64)
    counts[..., 0], counts[..., 1] = positive, negative
    return PPSMemory(("part:0",), np.zeros(1, np.intp), counts, params)


@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
@pytest.mark.parametrize(("positive", "negative"), [(1, 1), (3, 40), (700, 20), (2**40, 2**41)])
def test_one_cell_has_the_exact_beta_quantiles(positive, negative, level):
    """Jeffreys' interval of a binomial proportion, as SciPy has it."""
    exact = beta(positive + 0.5, negative + 0.5).interval(level)
    found = activation_interval(memory_of(positive, negative), [0.05], [1.0], level, samples_per_trial=1)
    np.testing.assert_allclose(np.ravel(found), exact, rtol=1e-6)


def test_correlated_samples_count_for_less():
    few = activation_interval(memory_of(5, 10), [0.05], [1.0], samples_per_trial=1)
    many = activation_interval(memory_of(20, 40), [0.05], [1.0], samples_per_trial=4)
    np.testing.assert_allclose(few, many)


def test_nothing_learned_is_nothing_known():
    lower, upper = activation_interval(PPSMemory(("a:1",), np.zeros(1, np.intp), np.zeros((1, 8, 4, 2), np.int64),
                                                 MemoryParams()), [0.05], [1.0])  # fmt: skip
    assert lower == 0  # the activation is
    assert upper > 0.98


def test_one_lucky_trial_is_not_certainty_but_many_are():
    params = MemoryParams()
    for samples, low, high in ((6, 0.3, 0.97), (600, 0.97, 1.0)):
        lower, upper = activation_interval(memory_of(samples, 0, params), [0.05], [1.0])
        assert activation(memory_of(samples, 0, params), [0.05], [1.0]) == pytest.approx(1.0)
        assert low - 0.15 < lower < high
        assert upper == pytest.approx(1.0)


def test_duplicated_trials_give_the_same_map_with_narrower_intervals():
    rng = np.random.default_rng(SEED)
    positive, negative = rng.integers(0, 9, (2, 8, 4))
    D, TTC = rng.uniform(-0.1, 0.2, (50, 1)), rng.uniform(0, 3, (50, 1))
    widths = []
    for copies in (1, 2, 8):
        memory = memory_of(copies * positive, copies * negative, MemoryParams())
        np.testing.assert_allclose(
            activation(memory, D, TTC), activation(memory_of(positive, negative, MemoryParams()), D, TTC)
        )
        lower, upper = activation_interval(memory, D, TTC)
        widths.append(upper - lower)
    assert np.all(widths[0] > widths[1])
    assert np.all(widths[1] > widths[2])


def test_outside_the_ranges_nothing_is_known():
    memory = memory_of(100, 100, MemoryParams())
    for D, TTC in ((0.3, 1.0), (0.1, np.inf), (0.1, -1.0), (np.nan, 1.0)):
        np.testing.assert_array_equal(np.ravel(activation_interval(memory, [D], [TTC])), [0, 1])


def test_intervals_hold_the_activation_and_stay_in_bounds():
    rng = np.random.default_rng(SEED)
    for scale in (1, 30, 10**12):
        memory = memory_of(*(rng.integers(0, scale + 1, (2, 8, 4)) * rng.integers(0, 2, (2, 8, 4))), MemoryParams())
        D, TTC = rng.uniform(-0.1, 0.2, (200, 1)), rng.uniform(0, 3, (200, 1))
        lower, upper = activation_interval(memory, D, TTC)
        middle = activation(memory, D, TTC)
        assert np.all((lower >= 0) & (lower <= middle) & (middle <= upper) & (upper <= 1))


@pytest.mark.parametrize("trials", [1, 8, 60])
def test_intervals_cover_what_the_map_settles_on(trials):
    """Trials that leave six samples each with one outcome, in two neighbouring cells of true probability p."""
    rng = np.random.default_rng(SEED)
    covered = []
    params = MemoryParams(bins=(2, 1))
    for _ in range(400):
        p = rng.beta(0.5, 0.5)
        touches = rng.binomial(trials, p)
        memory = memory_of(np.full((2, 1), 6 * touches), np.full((2, 1), 6 * (trials - touches)), params)
        lower, upper = activation_interval(memory, [0.05], [1.0])
        covered.append(float(lower[0]) <= p <= float(upper[0]))
    assert np.mean(covered) > 0.8  # 90 % asked for; six samples a trial, of which four count as one


def test_impossible_levels_are_refused():
    with pytest.raises(ValueError, match=r"level 1\.5: expected a share"):
        activation_interval(memory_of(1, 1), [0.05], [1.0], level=1.5)
    with pytest.raises(ValueError, match=r"samples_per_trial 0: expected"):
        activation_interval(memory_of(1, 1), [0.05], [1.0], samples_per_trial=0)
