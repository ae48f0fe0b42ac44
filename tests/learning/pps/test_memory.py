"""The PPS memory: counting, interpolation, and simulated objects whose contact probability is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import softmax

from learning.pps.buffer import EventBuffer, push, resample
from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples, learn, load_memory, save_memory
from pps_vision.errors import InputError
from pps_vision.robot.skin import icub_skin
from pps_vision.types import TaxelEvents

FOREARMS = icub_skin(("left_forearm", "right_forearm"))
N = len(FOREARMS.taxel_ids)


def touched(*indices):
    mask = np.zeros(N, bool)
    mask[list(indices)] = True
    return mask


def random_memory(seed=0, params=None):
    memory = PPSMemory.empty(FOREARMS, params or MemoryParams())
    counts = np.random.default_rng(seed).integers(0, 20, memory.counts.shape)
    return replace(memory, counts=counts)


def test_only_the_touched_body_part_learns():
    D = np.full((3, N), 0.1)
    TTC = np.ones((3, N))
    memory = count_samples(PPSMemory.empty(FOREARMS, MemoryParams()), D, TTC, touched(2, 5))
    samples = memory.counts.sum(axis=(1, 2))
    left = FOREARMS.part_index == 0
    np.testing.assert_array_equal(samples[left & touched(2, 5)], [[3, 0]] * 2)
    np.testing.assert_array_equal(samples[left & ~touched(2, 5)], [[0, 3]] * 10)
    assert samples[~left].sum() == 0


def test_learning_needs_a_touch_and_samples():
    events = TaxelEvents(0.0, FOREARMS.taxel_ids, np.full(N, 0.1), np.ones(N), touched())
    buffer = push(EventBuffer(), events)
    empty = PPSMemory.empty(FOREARMS, MemoryParams())
    assert learn(empty, buffer, touched()) is empty
    assert learn(empty, EventBuffer(), touched(1)) is empty
    assert learn(empty, buffer, touched(1)).counts[1].sum() == 1


def test_learning_counts_the_resampled_buffer():
    rng = np.random.default_rng(3)
    buffer = EventBuffer()
    for stamp_s in np.cumsum(rng.choice([0.03, 0.05, 0.2], 40)):
        D = rng.uniform(-0.2, 0.3, N)
        TTC = rng.uniform(-1, 4, N)
        D[rng.random(N) < 0.4] = np.nan
        TTC[rng.random(N) < 0.2] = np.inf
        buffer = push(buffer, TaxelEvents(stamp_s, FOREARMS.taxel_ids, D, TTC, touched()))
    memory = random_memory()
    felt = touched(1, 4)
    _, *series, _ = resample(buffer, np.arange(N))
    expected = count_samples(memory, *series, felt).counts
    assert (expected != memory.counts).any()
    np.testing.assert_array_equal(learn(memory, buffer, felt).counts, expected)
    with pytest.raises(ValueError, match="expected the memory's"):
        learn(memory, buffer, felt[:-1])


def test_outside_the_ranges_the_activation_is_0():
    memory = replace(random_memory(), counts=np.ones((N, 8, 4, 2), np.int64))
    for at in ((-0.101, 1), (0.201, 1), (0.1, -0.01), (0.1, 3.01), (0.1, np.inf), (np.nan, 1), (0.1, np.nan)):
        assert not activation(memory, *at).any()
    for at in ((-0.1, 1), (0.2, 1), (0.1, 0), (0.1, 3)):
        np.testing.assert_allclose(activation(memory, *at), 0.5)


@pytest.mark.parametrize(
    ("changed", "params"),
    [
        (lambda counts: counts + 2**40, MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75)),
        (
            lambda counts: 0.3 + 0.0 * counts,
            MemoryParams(bins=(4, 3, 5), miss_range_m=(-0.1, 0.3), prior_samples=(7.0, 0.5)),
        ),
    ],
)
def test_saved_and_loaded_is_the_same(tmp_path, changed, params):
    """Also large counts, shares of a touch, and predicted miss distances."""
    memory = random_memory(7, params)
    place = np.array([[0.3, 0.0, 0.0, 2.0, 0.1, 0.0, 2.0]])
    body = {"positions_m": np.full((N - 1, 3), 0.1), "offsets_rad": np.array([0.02]), "places": place}
    memory = replace(memory, counts=changed(memory.counts), **body)
    save_memory(tmp_path / "memory.npz", memory)
    again = load_memory(tmp_path / "memory.npz")
    assert (again.taxel_ids, again.params) == (memory.taxel_ids, memory.params)
    np.testing.assert_array_equal(again.counts, memory.counts)
    np.testing.assert_array_equal(again.part_index, memory.part_index)
    for name, values in body.items():
        np.testing.assert_array_equal(getattr(again, name), values)
    assert [p.name for p in tmp_path.iterdir()] == ["memory.npz"]


def rewrite(path, **changes):
    with np.load(path) as file:
        data = {**file, **changes}
    np.savez(path, **{k: v for k, v in data.items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 6}, "version 6; expected version 7"),
        ({"version": None}, "version unknown"),
        ({"version": np.array([1, 2])}, "version .1 2.; expected version 7"),
        ({"kind": None}, "is not a PPS memory"),
        ({"counts": np.zeros((2, 8, 4, 2), int)}, "does not fit together"),
        ({"counts": np.full((N, 8, 4, 2), -1)}, "does not fit together"),
        ({"counts": np.full((N, 8, 4, 2), np.nan)}, "does not fit together"),
        ({"counts": np.full((N, 8, 4, 2), np.inf)}, "does not fit together"),
        ({"part_index": np.full(N, np.nan)}, "does not fit together"),
        ({"ranges": np.zeros(3)}, "does not fit together"),
        ({"positions_m": np.zeros((2, 3))}, "does not fit together"),
        ({"places": np.zeros((1, 7))}, "does not fit together"),
        ({"places": np.ones((1, 6))}, "does not fit together"),
        ({"offsets_rad": np.full(3, np.nan)}, "does not fit together"),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path, changes, message):
    path = tmp_path / "memory.npz"
    save_memory(path, random_memory())
    rewrite(path, **changes)
    with pytest.raises(InputError, match=rf"memory\.npz.*{message}"):
        load_memory(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ttc_range_s": (3.0, 0.0)}, "ranges from low to high"),
        *(({"sigma_bins": width}, "a width above 0") for width in (0.0, 1e-300, 1.2e9)),  # the square of the one is 0
        *(({"bins": bins}, "at least one bin") for bins in ((0, 4), (8, 0))),
        ({"distance_range_m": (0.0, 1e-310)}, "a finite range"),
        ({"ttc_range_s": (0.0, 1.2e9)}, "a finite range"),
        ({"ttc_range_s": (-np.inf, np.inf)}, "a finite range where there is more than one bin"),
    ],
)
def test_params_out_of_order_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        MemoryParams(**changes)
    assert MemoryParams(ttc_range_s=(0.0, 1e9), bins=(1, 2)).bins == (1, 2)


def test_a_single_bin_may_stand_for_all_times():
    """The robot's 1-D maps know the distance only: receding, standing and coming are one to them."""
    params = MemoryParams(ttc_range_s=(-np.inf, np.inf), bins=(8, 1))
    memory = PPSMemory.empty(FOREARMS, params)
    memory = count_samples(memory, np.full((3, N), 0.1), np.array([[-1.0], [0.5], [1e9]]) * np.ones(N), touched(0))
    assert memory.counts[0, 5, 0, 0] == 3
    expected = activation(memory, 0.1, np.array([[-5.0], [0.0], [np.inf]]) * np.ones(N))
    assert expected[0, 0] > 0.3
    np.testing.assert_array_equal(expected[:, 0], expected[0, 0])
    upto_3_s = PPSMemory.empty(FOREARMS, MemoryParams(bins=(8, 1)))
    for ttc_s, n in ((3.0, 0), (np.nextafter(3.0, 0), 1)):  # its upper limit does not count
        memory = count_samples(upto_3_s, np.full((1, N), 0.1), np.full((1, N), ttc_s), touched(0))
        assert memory.counts[0, ..., 0].sum() == n


def test_a_buffer_or_distances_of_another_skin_are_refused():
    events = TaxelEvents(0.0, ("a",), np.full(1, 0.1), np.ones(1), np.zeros(1, bool))
    with pytest.raises(ValueError, match="a buffer of 1 taxels: expected those of the memory"):
        learn(random_memory(), push(EventBuffer(), events), touched(1))
    for at in ((np.full(3, 0.1), np.ones(N)), (np.full(N, 0.1), np.ones(3))):
        with pytest.raises(ValueError, match="expected those of the memory's 24 taxels"):
            activation(random_memory(), *at)
    alone, *repeated = (activation(random_memory(), *at) for at in ((0.1, 1.0), ([0.1], 1.0), (0.1, np.ones(N))))
    assert alone.shape == (N,)
    for activations in repeated:
        np.testing.assert_array_equal(activations, alone)


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bins=st.tuples(st.integers(1, 9), st.integers(1, 5)),
    sigma=st.sampled_from([1e-9, 0.1, 0.5, 1.0, 3.0, 1e9]),
)
def test_the_activation_is_the_mean_of_f_weighted_by_normalized_gaussians(seed, bins, sigma):
    """R eqs 4 and 5 with SciPy's softmax of the squared distances to the bin centres."""
    rng = np.random.default_rng(seed)
    memory = PPSMemory(
        ("a", "b"), np.zeros(2, np.intp), rng.integers(0, 9, (2, *bins, 2)), MemoryParams(bins=bins, sigma_bins=sigma)
    )
    D = np.append([-0.1, 0.2], rng.uniform(-0.1, 0.2, 38))
    TTC = np.append(rng.uniform(0, 3, 38), [0.0, 3.0])
    places = zip(((D + 0.1) / 0.3, TTC / 3), bins, strict=True)
    weights = [softmax(-(((x * n)[:, None] - np.arange(n) - 0.5) ** 2) / (2 * sigma**2), axis=1) for x, n in places]
    expected = np.einsum("kd,ndt,kt->kn", weights[0], memory.frequency, weights[1])
    np.testing.assert_allclose(
        activation(memory, D[:, None], TTC[:, None] * np.ones(2)), expected, rtol=1e-6, atol=1e-9
    )


def exact_probability(memory, taxel, at):
    """P of a memory that knows the path, with SciPy's softmax of the squared distances to the bin centres."""
    params = memory.params
    ranges = params.distance_range_m, params.ttc_range_s, params.miss_range_m
    weights = []
    for x, (low, high), n in zip(at, ranges, params.bins, strict=True):
        offset = (x - low) / (high - low) * n - np.arange(n) - 0.5
        weights.append(softmax(-(offset**2) / (2 * params.sigma_bins**2)))
    counts = memory.counts[..., 0], memory.counts.sum(axis=-1)
    touch, total = (np.einsum("ndtm,d,t,m->n", c, *weights) for c in counts)
    of_taxel, of_part = params.prior_samples
    same = memory.part_index == memory.part_index[taxel]
    part = touch[same].sum() / (total[same].sum() + of_part)
    return (touch[taxel] + of_taxel * part) / (total[taxel] + of_taxel)


def test_the_probability_is_that_of_smoothed_counts_shrunk_to_the_body_part_and_to_0():
    params = MemoryParams(bins=(5, 3, 4), sigma_bins=0.8, miss_range_m=(-0.04, 0.12), prior_samples=(3.0, 2.0))
    memory = random_memory(5, params)
    for at in ((0.05, 1.2, 0.0), (-0.09, 0.1, 0.11), (0.19, 2.9, -0.03)):
        for taxel in (0, 13):
            assert activation(memory, *at)[taxel] == pytest.approx(exact_probability(memory, taxel, at))
    beyond = [activation(memory, 0.05, 1.0, miss) for miss in (0.12, 0.5, -0.04, -np.inf)]
    np.testing.assert_array_equal(beyond[0], beyond[1])
    np.testing.assert_array_equal(beyond[2], beyond[3])
