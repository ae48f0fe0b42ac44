"""The learner on the real robot's own data: held-out contact prediction, and the authors' own landscape."""

import numpy as np
import pytest
from data import SEED, shared_data

from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.scores import auroc, brier, expected_calibration_error
from learning.pps.trials import load_trials
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import by_base_rate, by_displacement, in_blocks, outcomes


def test_the_published_scores_leaving_one_trial_out():
    """AUROC and Brier score as in docs/protocol.md, and those of the base rate as in the data's description."""
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    touched = outcomes(trials)
    assert touched.sum(axis=0).tolist() == [29, 3, 0, 11]
    p, base_rate = (in_blocks(predict, trials, HORIZON_S) for predict in (by_displacement, by_base_rate))
    assert (auroc(touched, p), brier(touched, p)) == pytest.approx((0.909, 0.109), abs=0.001)
    assert expected_calibration_error(touched, p) <= 0.06
    assert (auroc(touched, base_rate), brier(touched, base_rate)) == pytest.approx((0.82, 0.12), abs=0.002)


def test_two_thirds_of_the_session_predict_the_rest():
    """Better than the base rate of the trials learned from."""
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    rng, gains = np.random.default_rng(SEED), []
    for _ in range(60):
        order = rng.permutation(len(trials))
        training, test = ([trials[i] for i in part] for part in (order[:24], order[24:]))
        p, base = (predict(training, test, HORIZON_S) for predict in (by_displacement, by_base_rate))
        now = outcomes(test)
        gains.append((auroc(now, p) - auroc(now, base), brier(now, base) - brier(now, p)))
    assert np.all(np.mean(gains, axis=0) > (0.015, 0.005))


def test_their_counts_give_their_landscape():
    """R eq. 3 on the published counts after four trials; bins with a single sample count as unvisited there."""
    with np.load(shared_data("pps_real_robot", "histograms_after_1_and_4_trials.npz")) as file:
        theirs = np.stack([file["E4_positive"], file["E4_negative"]], -1).astype(np.int64)
        published = file["E4_H"]
    memory = PPSMemory(tuple("0123"), np.zeros(4, np.intp), theirs, MemoryParams())
    several = theirs.sum(axis=-1) > 1
    np.testing.assert_allclose(np.where(several, memory.frequency, 0), published, atol=1e-9)
