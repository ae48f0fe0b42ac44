"""Trials files, read as they were written or refused."""

import numpy as np
import pytest
from trials_made_up import session, write

from learning.pps.trials import load_trials, touch_rates
from pps_vision.errors import InputError


def test_a_trials_file_is_read_as_it_was_written(tmp_path):
    trials = session(np.random.default_rng(3), 3)
    for trial, again in zip(trials, load_trials(write(tmp_path / "trials.npz", trials)), strict=True):
        np.testing.assert_array_equal(again.d_m, trial.d_m)
        np.testing.assert_array_equal(again.v_m_s, trial.v_m_s)
        np.testing.assert_array_equal(again.touched, trial.touched)
        np.testing.assert_allclose(again.stamps_s, trial.stamps_s)
        assert again.radius_m == 0  # a file has none: displacements are to the centre


def test_rates_are_shares_of_trials():
    np.testing.assert_allclose(touch_rates(session(np.random.default_rng(3), 5)), [3 / 5, 2 / 5, 0])


def test_what_is_not_finite_is_unknown(tmp_path):
    trials = session(np.random.default_rng(3), 2)
    trials[1].d_m[4, 2, 1] = np.inf
    again = load_trials(write(tmp_path / "trials.npz", trials))[1]
    assert np.isnan(again.d_m[4, 2, 1])
    assert np.isnan(again.d_m).sum() == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outcome": None}, "no outcome; expected trials with position_m"),
        ({"position_m": None, "velocity_m_s": None}, "no position_m, velocity_m_s;"),
        ({"outcome": np.ones(9, int)}, r"outcome of shape \(9,\)"),
        ({"outcome": np.ones((0, 3), int)}, r"outcome of shape \(0, 3\)"),
        ({"outcome": np.full((3, 3), np.nan)}, "nan in outcome; expected 1"),
        ({"outcome": np.full((3, 3), 7)}, "7 in outcome; expected 1"),
        ({"outcome": np.full((3, 3), "yes")}, "outcome holds <U3; expected numbers"),
        ({"offsets": np.arange(4)}, r"offsets of shape \(4,\); expected 10 whole numbers"),
        ({"offsets": np.linspace(0, 180, 10)}, "float64 offsets of shape"),
        ({"offsets": 20 * np.arange(10)[::-1]}, "do not rise from 0"),
        ({"offsets": np.array([0, 19, *range(40, 181, 20)])}, "trial 0 have different lengths"),
        ({"position_m": np.zeros((180, 2))}, r"position_m of shape \(180, 2\); expected \(180, 3\)"),
        ({"velocity_m_s": np.zeros((179, 3))}, r"velocity_m_s of shape \(179, 3\); expected \(180, 3\)"),
    ],
)
def test_a_bad_trials_file_is_refused(tmp_path, changes, message):
    path = write(tmp_path / "trials.npz", session(np.random.default_rng(4), 3), **changes)
    with pytest.raises(InputError, match=rf"trials\.npz: .*{message}"):
        load_trials(path)


def test_no_file_and_no_archive_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"gone\.npz: cannot be read: No such file"):
        load_trials(tmp_path / "gone.npz")
    (tmp_path / "text.npz").write_text("trial,taxel\n")
    with pytest.raises(InputError, match=r"text\.npz: is not a readable \.npz file"):
        load_trials(tmp_path / "text.npz")


def test_a_damaged_trials_file_is_refused(tmp_path):
    path = write(tmp_path / "trials.npz", session(np.random.default_rng(5), 3))
    sound = path.read_bytes()
    # the first member's compression method, at bytes 8–9 of the file and 10–11 of its directory entry
    entry = sound.index(b"PK\x01\x02")
    for content in (b"\x08\x00", b"\x63\x00"):
        damaged = bytearray(sound)
        damaged[8:10] = damaged[entry + 10 : entry + 12] = content
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"trials\.npz: is not a readable \.npz file"):
            load_trials(path)
