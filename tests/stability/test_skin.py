"""The skin under any input: no NaN, no certainty without samples, lost samples counted."""

import numpy as np
import pytest
from data import SEED
from hypothesis import given, settings
from hypothesis import strategies as st

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.robot.skin import icub_skin

SKIN = icub_skin(("left_palm",))
UP = np.array([0.0, 0.0, 1.0])
AT = np.array([[0.03 * i, 0.0, 0.0] for i in range(4)])  # four taxels in a row, facing up
FACING = np.tile(UP, (4, 1))
PARAMS = MemoryParams()


def sees(p, v, **options):
    return perceive(ReceptiveField(), AT, FACING, p, v, **options)


def trial(rng, aimed, steps=40):
    """D and TTC (T, 4) of a straight approach to a taxel from above, and who is touched."""
    start = AT[aimed] + np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.15, 0.2)])
    way = np.linspace(0, 1, steps)[:, None]
    v = (AT[aimed] - start) / (0.05 * steps)
    return *sees(start + way * (AT[aimed] - start), v), np.arange(4) == aimed


def learned(trials, params=PARAMS):
    memory = PPSMemory.empty(SKIN, params)
    for D, TTC, touched in trials:
        memory = count_samples(memory, D, TTC, touched)
    return memory


def trials(n, seed=SEED):
    rng = np.random.default_rng(seed)
    return [trial(rng, k % 4) for k in range(n)]


FAR = 1e200  # metres or metres a second, from a broken filter
coordinate = st.sampled_from([0.0, -0.0, 1e-300, -1e-9, 0.02, -0.05, 0.1, 0.2, 3.0, -FAR, FAR, np.inf, -np.inf, np.nan])
vector = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=200, deadline=None)
@given(p=vector, v=vector, std=st.sampled_from([0.0, 1e-3, 1.0, FAR, np.nan]))
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_whatever_a_tracker_says_activations_are_probabilities(p, v, std):
    """On the taxel, behind it, tangential, standing, infinite, no number: 0 ≤ activation ≤ 1."""
    memory = MEMORY
    with np.errstate(all="ignore"):
        D, TTC = sees(p, v, cov_v=np.float64(std) ** 2 * np.eye(3))
        expected = activation(memory, D, TTC)
    assert np.all((expected >= 0) & (expected <= 1))
    assert np.array_equal(np.isnan(D), np.isnan(TTC))
    counted = count_samples(memory, D[None], TTC[None], np.arange(4) == 1)
    gained = counted.counts - memory.counts
    assert gained.min() >= 0
    assert gained.sum() <= 4


MEMORY = learned(trials(12))


def test_every_edge_of_every_bin_is_counted_once_or_not_at_all():
    """The lowest edge belongs to the first bin, an inner one to the bin above it, the highest to none; samples outside
    the ranges and unknown ones to none."""
    d = np.array([-0.11, *np.linspace(*PARAMS.distance_range_m, PARAMS.bins[0] + 1), np.nan])
    t = np.array([-0.1, *np.linspace(*PARAMS.ttc_range_s, PARAMS.bins[1] + 1), np.nan])
    D, TTC = (np.repeat(g.reshape(-1, 1), 4, axis=1) for g in np.meshgrid(d, t, indexing="ij"))
    memory = count_samples(PPSMemory.empty(SKIN, MemoryParams()), D, TTC, np.arange(4) == 0)
    np.testing.assert_array_equal(memory.counts[0], np.broadcast_to([1, 0], memory.counts[0].shape))
    np.testing.assert_array_equal(memory.counts[1:], np.broadcast_to([0, 1], memory.counts[1:].shape))
    for at in (d[1], d[-2], np.nextafter(d[-2], 1), np.nextafter(d[1], -1)):
        expected = activation(MEMORY, np.full(4, at), np.full(4, 0.4))
        assert np.all(expected > 0) == (PARAMS.distance_range_m[0] <= at <= PARAMS.distance_range_m[1])
