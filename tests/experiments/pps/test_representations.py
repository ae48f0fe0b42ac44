"""Which representation of touch to take: splits of a session, and the study on a few trials."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw
from trials_made_up import session, write

from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps.movements import SessionName
from pps_vision.experiments.pps.representations import SIZES, Representations, early_and_late
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
