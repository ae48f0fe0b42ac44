"""Tables of counts on samples whose probability of touch is known."""

import numpy as np
import pytest
from data import SEED

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples
from pps_vision.experiments.pps.count_table import CountTable
from pps_vision.types import Array, Mask

FINE = MemoryParams(bins=(24, 8))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def truth(distance_m: Array) -> Array:
    """A probability of touch that falls with distance, less for the second taxel."""
    p: Array = np.clip(1 - distance_m / 0.2, 0, 1) * np.array([1.0, 0.5])
    return p


def drawn(n: int, rng: np.random.Generator) -> tuple[Array, Array, Mask]:
    D, TTC = rng.uniform(0, 0.2, (n, 2)), rng.uniform(0.2, 2.8, (n, 2))
    return D, TTC, rng.uniform(size=(n, 2)) < truth(D)


@pytest.mark.parametrize("what", [CountTable(FINE), CountTable(FINE, normalised=True)])
def test_what_is_learned_is_the_probability_of_touch(what: CountTable, rng: np.random.Generator) -> None:
    foresee = what.fit(*drawn(3000, rng))
    D, TTC = rng.uniform(0.03, 0.17, (200, 2)), rng.uniform(0.6, 2.4, (200, 2))
    assert np.abs(foresee(D, TTC) - truth(D)).mean() < 0.08
    assert np.all(foresee(np.array([np.nan, 0.1]), np.array([1.0, np.nan])) == 0)


def test_counts_are_those_of_the_memory(rng: np.random.Generator) -> None:
    D, TTC, _ = drawn(300, rng)
    memory = PPSMemory(("a", "b"), np.zeros(2, np.intp), np.zeros((2, *FINE.bins, 2), np.int64), FINE)
    memory = count_samples(memory, D, TTC, np.array([True, False]))
    foresee = CountTable(FINE).fit(D, TTC, np.broadcast_to([True, False], D.shape))
    np.testing.assert_allclose(foresee(D, TTC), activation(memory, D, TTC))


def test_normalised_nothing_speaks_for_no_touch_where_nothing_was_seen(rng: np.random.Generator) -> None:
    D, TTC = np.full((5, 1), 0.05), np.full((5, 1), 0.5)
    all_touched = np.ones((5, 1), bool)
    seen = (np.array([0.08]), np.array([1.0]))
    assert CountTable(FINE, normalised=True).fit(D, TTC, all_touched)(*seen) == pytest.approx(1.0)
    assert CountTable(FINE).fit(D, TTC, all_touched)(*seen) < 0.5


def test_a_taxel_learns_from_its_neighbour_when_pooled(rng: np.random.Generator) -> None:
    D, TTC = np.array([[0.05, np.nan]]), np.array([[0.5, np.nan]])
    touched = np.array([[True, True]])
    here = np.array([0.05, 0.05]), np.array([0.5, 0.5])
    assert CountTable(FINE, normalised=True).fit(D, TTC, touched)(*here)[1] == 0
    assert CountTable(FINE, normalised=True, pooled=0.1).fit(D, TTC, touched)(*here)[1] == pytest.approx(1.0)
