"""Ways to predict touches, on trials whose answer is known; and the whole experiment on a few of them."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED
from trials_made_up import session, write

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.scores import auroc
from learning.pps.trials import touch_rates
from pps_vision.experiments.pps.real_trials import RealTrials, left_out
from pps_vision.experiments.pps.simulated_sessions import two_sessions
from pps_vision.experiments.pps.trial_methods import METHODS, OURS, Plain


@pytest.mark.parametrize("reference", ["taxel", "surface", "landing"])
@pytest.mark.parametrize("average", [False, True])
def test_the_map_foretells_nothing_from_what_is_not_yet_known(reference, average):
    _is_blind_to_the_end(Plain(reference=reference, average=average))


@pytest.mark.parametrize("name", METHODS)
def test_no_method_uses_what_is_not_yet_known(name):
    _is_blind_to_the_end(METHODS[name])


def _is_blind_to_the_end(method):
    """The last moments of a trial predicted may be anything; those of trials learned from are known by then."""
    trials = session(np.random.default_rng(SEED), 10)
    others = tuple(replace(t, d_m=t.d_m.copy(), v_m_s=t.v_m_s.copy()) for t in trials)
    for trial in others[7:]:
        trial.d_m[-2:], trial.v_m_s[-2:] = 0.05, -1.0
    first, last = np.arange(7), np.arange(7, 10)
    a, b = (method(group, 0.15)(first, last) for group in (trials, others))
    np.testing.assert_array_equal(a, b)
    assert ((a >= 0) & (a <= 1)).all()


def test_the_base_rate_is_that_of_the_others():
    trials = session(np.random.default_rng(SEED), 6)
    touched = np.array([trial.touched for trial in trials])
    np.testing.assert_allclose(left_out(METHODS["base rate"], trials), (touched.sum(axis=0) - touched) / 5)


def test_what_passes_beside_each_other_only_displacement_tells_apart():
    """Both taxels see the same D and TTC whichever is aimed at, but for the side."""
    trials = session(np.random.default_rng(SEED), 16, beside_m=0.004)
    touched = np.array([trial.touched for trial in trials])
    found = {name: left_out(METHODS[name], trials)[:, :2] for name in ("displacement, Parzen", OURS)}
    assert all(auroc(touched[:, :2], p) > 0.95 for p in found.values())


def test_simulated_sessions_are_like_the_real_ones():
    """Every trial ends in a touch, most in one; paths end 1–2 cm apart, as the real ones; one session tells of the
    next, but not all."""
    pairs = [two_sessions(np.random.default_rng((SEED, k))) for k in range(12)]
    gains = []
    for first, second in pairs:
        touched = np.array([trial.touched for trial in second])
        assert touched.any(axis=1).all()
        assert 1 <= touched.sum(axis=1).mean() < 2.5
        spread = np.std([trial.d_m[-1, 0] for trial in second], axis=0)[:2]
        assert ((spread > 0.006) & (spread < 0.02)).all()
        p = predict_contact(ContactParams(), learn_contact(ContactParams(), first), second).probability
        rate = np.tile(touch_rates(first), (len(second), 1))
        gains.append((auroc(touched, p), auroc(touched, p) - auroc(touched, rate)))
    area, gain = np.mean(gains, axis=0)
    assert 0.8 < area < 0.95
    assert gain > 0.01


def test_the_whole_experiment_on_a_few_trials(tmp_path):
    folder = tmp_path / "pps_real_robot"
    folder.mkdir()
    write(folder / "trials_forearm_internal.npz", session(np.random.default_rng(SEED), 8, beside_m=0.01))
    experiment = RealTrials(data=tmp_path, splits=2, resamples=20, permutations=2, pairs=1)
    numbers = experiment.run()
    assert list(numbers["methods"]) == list(METHODS)
    low, high = numbers["methods"][OURS]["auroc_95"]
    assert low <= high
    assert sum(numbers["calibration"]["n"]) == 8 * 3
    assert sum(row["default"] for row in numbers["choices"]) == 4
    assert set(experiment.chart(numbers)) == {"methods", "horizon", "choices", "reliability"}


def test_without_data_it_says_so(tmp_path):
    experiment = RealTrials(data=tmp_path)
    assert "trials_forearm_internal" in (numbers := experiment.run())["skipped"]
    assert experiment.chart(numbers) == {}
