"""Predicted touches of recorded trials whose answer is known, and the study on a few of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from data import SEED, shared_data
from drawn_study import run_and_draw
from trials_made_up import session, write

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.scores import auroc, brier
from learning.pps.trials import load_trials, touch_rates
from pps_vision.experiments.pps.real_trials import HORIZON_S, RealTrials
from pps_vision.experiments.pps.simulated_sessions import two_sessions
from pps_vision.experiments.pps.trial_methods import METHODS, OURS, in_blocks, leave_one_out, outcomes


@pytest.mark.parametrize("name", METHODS)
def test_no_method_uses_what_is_not_yet_known(name: str) -> None:
    """The last moments of a test trial may be anything; those of training trials are known."""
    trials = session(np.random.default_rng(SEED), 10)
    others = tuple(replace(t, d_m=t.d_m.copy(), v_m_s=t.v_m_s.copy()) for t in trials)
    for trial in others[7:]:
        trial.d_m[-2:], trial.v_m_s[-2:] = 0.05, -1.0
    first, last = np.arange(7), np.arange(7, 10)
    a, b = (METHODS[name](group, 0.15)(first, last) for group in (trials, others))
    np.testing.assert_array_equal(a, b)
    assert ((a >= 0) & (a <= 1)).all()


def test_the_base_rate_is_that_of_the_other_trials() -> None:
    trials = session(np.random.default_rng(SEED), 6)
    touched = outcomes(trials)
    expected = (touched.sum(axis=0) - touched) / 5
    np.testing.assert_allclose(leave_one_out(METHODS["base rate"], trials, HORIZON_S), expected)
    halves = in_blocks(METHODS["base rate"], trials, HORIZON_S, 2)
    np.testing.assert_allclose(halves[0], touched[3:].mean(axis=0))


def test_displacement_tells_paths_over_neighbours_apart() -> None:
    """Both taxels see the same D and TTC whichever is aimed at, but for the side."""
    trials = session(np.random.default_rng(SEED), 16, beside_m=0.004)
    p = leave_one_out(METHODS[OURS], trials, HORIZON_S)
    assert auroc(outcomes(trials)[:, :2], p[:, :2]) > 0.95


def test_simulated_sessions_are_like_the_real_ones() -> None:
    """Every trial ends in a touch, most in one; paths end 1–2 cm apart; one session predicts the next, but not all."""
    pairs = [two_sessions(np.random.default_rng((SEED, k))) for k in range(12)]
    gains = []
    for first, second in pairs:
        touched = outcomes(second)
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


def test_the_study_on_a_few_trials(tmp_path: Path) -> None:
    folder = tmp_path / "pps_real_robot"
    folder.mkdir()
    write(folder / "trials_forearm_internal.npz", session(np.random.default_rng(SEED), 8, beside_m=0.01))
    numbers, charts = run_and_draw(RealTrials(data=tmp_path, splits=2, permutations=2, pairs=1))
    assert list(numbers["methods"]) == list(METHODS)
    value, low, high = numbers["methods"][OURS]["leave_one_out"]["auroc"]
    assert low <= value <= high
    assert set(charts) == {"methods", "horizon", "reliability"}


def test_without_data_the_study_is_skipped(tmp_path: Path) -> None:
    study = RealTrials(data=tmp_path)
    assert "trials_forearm_internal" in (numbers := study.run())["skipped"]
    assert study.chart(numbers) == {}
    assert study.tables(numbers) == {}


def test_the_published_scores_of_the_real_trials() -> None:
    trials = load_trials(shared_data("pps_real_robot", "trials_forearm_internal.npz"))
    p = leave_one_out(METHODS[OURS], trials, HORIZON_S)
    assert auroc(outcomes(trials), p) == pytest.approx(0.909, abs=0.001)
    assert brier(outcomes(trials), p) == pytest.approx(0.109, abs=0.001)
