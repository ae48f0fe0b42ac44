"""The learner on the real robot's own data: held-out contact prediction, and the authors' own landscape."""

import numpy as np
import pytest
from data import shared_data

from learning.pps.memory import MemoryParams, PPSMemory
from pps_vision.experiments.pps.taxel_trials import load_trials
from pps_vision.experiments.pps_prediction import (
    auroc,
    brier,
    brier_gain,
    by_base_rate,
    by_shrunk_map,
    in_blocks,
    outcomes,
)


def test_no_split_of_the_session_in_time_is_predicted_worse_than_by_the_base_rate():
    """Blocks of consecutive trials, and the first or last trials from the others, by the map shrunk to the base
    rate; the scores of the constant rates agree with the description of the data."""
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    touched = outcomes(trials)
    assert touched.sum(axis=0).tolist() == [29, 3, 0, 11]
    rates = np.tile(touched.mean(axis=0), (37, 1))
    assert (auroc(touched, rates), brier(touched, rates)) == pytest.approx((0.889, 0.113), abs=0.001)
    for blocks in (2, 3, 4, 6):
        p, base = (in_blocks(predict, trials, blocks) for predict in (by_shrunk_map, by_base_rate))
        assert brier_gain(touched, p, base)[2] >= 0
    for n in (12, 18, 24):
        for training, test in ((trials[:n], trials[n:]), (trials[-n:], trials[:-n])):
            p, base = (predict(training, test) for predict in (by_shrunk_map, by_base_rate))
            assert brier_gain(outcomes(test), p, base)[2] >= 0


def test_their_counts_give_their_landscape():
    """R eq. 3 on the published counts after four trials; bins with a single sample count as unvisited there."""
    with np.load(shared_data("pps_real_robot", "histograms_after_1_and_4_trials.npz")) as file:
        theirs = np.stack([file["E4_positive"], file["E4_negative"]], -1).astype(np.int64)
        published = file["E4_H"]
    memory = PPSMemory(tuple("0123"), np.zeros(4, np.intp), theirs, MemoryParams())
    several = theirs.sum(axis=-1) > 1
    np.testing.assert_allclose(np.where(several, memory.frequency, 0), published, atol=1e-9)
