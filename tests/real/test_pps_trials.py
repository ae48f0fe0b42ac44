"""The learner on the real robot's own data: held-out contact prediction, and the authors' own counts."""

import numpy as np
import pytest
from data import shared_data

from learning.memory import MemoryParams, PPSMemory, count_samples
from learning.receptive_field import ReceptiveField, distance_and_ttc
from learning.scores import auroc, brier
from learning.trials import PredictionParams, leave_one_out, load_trials

UP = np.array([0.0, 0.0, 1.0])
EVERYWHERE = ReceptiveField(base_radius_m=10.0)  # the authors' counts know no cone


def test_contact_is_predicted_on_trials_held_out():
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    result = leave_one_out(PredictionParams(), trials)
    assert result.touched.sum(axis=0).tolist() == [29, 3, 0, 11]
    scores = [(name, auroc(result.touched, p), brier(result.touched, p))
              for name, p in (("learned", result.probability), ("base rate", result.base_rate))]  # fmt: skip
    for name, area, error in scores:
        print(f"{name}: AUROC {area:.3f}, Brier {error:.4f}")
    assert scores[0][1] >= 0.865
    assert scores[0][2] <= 0.118
    assert scores[1][1:] == pytest.approx((0.82, 0.12), abs=0.002)  # what the data's description says


def counted(D, TTC, touched, ttc_max):
    """Counts (n, 8, 4, 2) of samples (T, n), all taxels on one part."""
    n = len(touched)
    params = MemoryParams(ttc_range_s=(0.0, ttc_max))
    blank = PPSMemory(tuple(map(str, range(n))), np.zeros(n, np.intp), np.zeros((n, 8, 4, 2), np.int64), params)
    return count_samples(blank, D, TTC, touched).counts


def from_landing(d, v):
    """D and TTC measured from where the path ends, as the published maps do; that point itself is no sample."""
    return distance_and_ttc(EVERYWHERE, d[:-1] - d[-1], UP, v[:-1])


def test_monte_carlo_counts():
    """500 simulated objects; the second taxel is there to be touched when the first is not."""
    with np.load(shared_data("pps_real_robot", "monte_carlo_500_events.npz")) as file:
        data = dict(file)
    assert (data["outcome"] > 0).sum() == 274
    counts = np.zeros((8, 4, 2), np.int64)
    for start, stop, outcome in zip(data["offsets"][:-1], data["offsets"][1:], data["outcome"] > 0, strict=True):
        D, TTC = from_landing(data["position_m"][start:stop], data["velocity_m_s"][start:stop])
        pair = counted(np.stack([D, D], 1), np.stack([TTC, TTC], 1), np.array([outcome, not outcome]), 3.0)
        counts += pair[0]
    theirs = np.stack([data["positive_counts"], data["negative_counts"]], axis=-1).astype(int)
    difference = np.abs(counts - theirs).sum() / theirs.sum()
    print(f"Monte Carlo: counts differ by {100 * difference:.3f} % in L1")
    assert difference <= 0.001


def test_counts_after_one_and_four_trials():
    """The paper's Fig 9 came from the trials with indices 17 (first) and 14–17 (first four); found by
    comparing all trials and all sets of four with the published counts."""
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    with np.load(shared_data("pps_real_robot", "histograms_after_1_and_4_trials.npz")) as file:
        theirs = {n: np.stack([file[f"E{n}_positive"], file[f"E{n}_negative"]], -1).astype(int) for n in (1, 4)}
        published = file["E4_H"]
    ours = {n: np.zeros((4, 8, 4, 2), np.int64) for n in (1, 4)}
    for n, chosen in ((1, (17,)), (4, (14, 15, 16, 17))):
        for i in chosen:
            ours[n] += counted(*from_landing(trials[i].d_m, trials[i].v_m_s), trials[i].touched, 1.2)
    differences = [np.abs(ours[n] - theirs[n]).sum() for n in (1, 4)]
    total = sum(theirs[n].sum() for n in (1, 4))
    print(f"after 1 and 4 trials: counts differ by {differences} of {total} samples")
    assert sum(differences) / total <= 0.08
    # R eq. 3 on their counts is their landscape, where bins with a single sample count as unvisited
    params = MemoryParams()
    memory = PPSMemory(tuple("0123"), np.zeros(4, np.intp), theirs[4].astype(np.int64), params)
    several = theirs[4].sum(axis=-1) > 1
    np.testing.assert_allclose(np.where(several, memory.frequency, 0), published, atol=1e-9)
