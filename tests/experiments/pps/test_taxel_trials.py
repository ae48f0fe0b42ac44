"""Trials files, read as they were written or refused."""

import numpy as np
import pytest
from trials_made_up import session, write

from pps_vision.errors import InputError
from pps_vision.experiments.pps.taxel_trials import load_trials, touch_rates


def test_a_trials_file_is_read_as_it_was_written(tmp_path):
    trials = session(np.random.default_rng(3), 3)
    trials[1].d_m[4, 2, 1] = np.inf
    for trial, again in zip(trials, load_trials(write(tmp_path / "trials.npz", trials)), strict=True):
        np.testing.assert_array_equal(again.d_m, np.where(np.isfinite(trial.d_m), trial.d_m, np.nan))
        np.testing.assert_array_equal(again.v_m_s, trial.v_m_s)
        np.testing.assert_array_equal(again.touched, trial.touched)
        np.testing.assert_allclose(again.stamps_s, trial.stamps_s)
        assert again.radius_m == 0  # a file has none: displacements are to the centre


def test_rates_are_shares_of_trials():
    np.testing.assert_allclose(touch_rates(session(np.random.default_rng(3), 5)), [3 / 5, 2 / 5, 0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outcome": None}, "no outcome; expected trials with position_m"),
        ({"offsets": np.arange(4)}, r"offsets of shape \(4,\); expected \(trials, taxels\)"),
        ({"offsets": np.array([0, 19, *range(40, 181, 20)])}, "different numbers of samples"),
    ],
)
def test_a_bad_trials_file_is_refused(tmp_path, changes, message):
    path = write(tmp_path / "trials.npz", session(np.random.default_rng(4), 3), **changes)
    with pytest.raises(InputError, match=rf"trials\.npz: .*{message}"):
        load_trials(path)
