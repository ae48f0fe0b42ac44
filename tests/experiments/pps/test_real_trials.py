"""Predicted touches of recorded trials whose answer is known, and the study on a few of them."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw
from trials_made_up import session, write

from pps_vision.experiments.pps import real_trials
from pps_vision.experiments.pps.predictors import in_blocks, outcomes
from pps_vision.experiments.pps.real_trials import HORIZON_S, METHODS, RealTrials


def test_the_base_rate_is_that_of_the_other_trials() -> None:
    trials = session(np.random.default_rng(SEED), 6)
    touched = outcomes(trials)
    expected = (touched.sum(axis=0) - touched) / 5
    np.testing.assert_allclose(in_blocks(METHODS["base rate"], trials, HORIZON_S), expected)
    halves = in_blocks(METHODS["base rate"], trials, HORIZON_S, 2)
    np.testing.assert_allclose(halves[0], touched[3:].mean(axis=0))


def test_the_study_on_a_few_trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real_trials, "HORIZONS_S", (0.0, 0.5))
    folder = tmp_path / "pps_real_robot"
    folder.mkdir()
    write(folder / "trials_forearm_internal.npz", session(np.random.default_rng(SEED), 8, beside_m=0.01))
    numbers, charts = run_and_draw(RealTrials(data=tmp_path))
    assert list(numbers["methods"]) == list(METHODS)
    value, low, high = numbers["methods"]["R's map, shrunk to the base rate"]["early_late"]["auroc"]
    assert low <= value <= high
    assert set(charts) == {"methods", "horizon"}


def test_without_data_the_study_is_skipped(tmp_path: Path) -> None:
    study = RealTrials(data=tmp_path)
    assert "trials_forearm_internal" in (numbers := study.run())["skipped"]
    assert study.chart(numbers) == {}
    assert study.tables(numbers) == {}
