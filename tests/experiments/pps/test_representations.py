"""Which representation to take: splits of a session, and paired differences over what is independent."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw
from scipy.stats import ttest_rel
from trials_made_up import session, write

from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps import representations
from pps_vision.experiments.pps.movements import SessionName
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import by_base_rate, by_displacement, in_blocks, outcomes
from pps_vision.experiments.pps.representations import BLOCKS, CONTACT_MODEL, SIZES, Representations, early_and_late
from pps_vision.experiments.pps.trials import exact_trials


@pytest.mark.parametrize(("n", "late", "early"), [(53, 13, (6, 12, 24)), (37, 13, (6, 12, 24)), (10, 5, (5, 5, 5))])
def test_the_last_trials_are_predicted_from_as_many_first_ones_as_stated(
    n: int, late: int, early: tuple[int, ...]
) -> None:
    """24 and 13 of the authors' 37, as in `pps_real_trials`."""
    trials = session(np.random.default_rng(SEED), n)
    splits = [early_and_late(trials, size) for size in SIZES]
    assert tuple(len(first) for first, _ in splits) == early
    assert all(list(last) == list(trials[n - late :]) for _, last in splits)
    assert all(list(first) == list(trials[: len(first)]) for first, _ in splits)


@pytest.mark.parametrize("n_sessions", [1, 3])
def test_the_paired_difference_is_over_the_sessions_or_over_the_trials_of_one(
    n_sessions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    methods = {"base rate": by_base_rate, CONTACT_MODEL: by_displacement}
    monkeypatch.setattr(representations, "METHODS", methods)
    rng = np.random.default_rng(SEED)
    sessions = [session(rng, 8, beside_m=0.006) for _ in range(n_sessions)]
    errors = []
    for method in methods.values():
        of = [(in_blocks(method, s, HORIZON_S, BLOCKS) - outcomes(s)) ** 2 for s in sessions]
        errors.append([one.mean() for one in (of[0] if n_sessions == 1 else of)])
    expected = ttest_rel(*errors)
    low, high = expected.confidence_interval(0.95)
    found = representations._scores(sessions)["base rate"]["above_contact_model"]
    np.testing.assert_allclose(found, [np.subtract(*errors).mean(), low, high])


@pytest.mark.long
def test_the_study_on_a_few_trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact trials in place of rendered ones, made-up ones in place of the authors'."""

    def exact(name: SessionName, n: int, seed: int, folder: Path) -> tuple[TouchTrial, ...]:
        return exact_trials(name, n, seed)

    monkeypatch.setattr("pps_vision.experiments.pps.trials.rendered_trials", exact)
    (tmp_path / "pps_real_robot").mkdir()
    write(tmp_path / "pps_real_robot" / "trials_forearm_internal.npz", session(np.random.default_rng(SEED), 8))
    numbers, charts = run_and_draw(Representations(SEED, share=0.1, n=2, data=tmp_path))
    assert {source: of["sessions"] for source, of in numbers["sources"].items()} == {
        "simulated": 2,
        "rendered": 1,
        "real": 1,
    }
    assert set(charts) == {""}
