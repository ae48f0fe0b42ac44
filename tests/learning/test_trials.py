"""Leave-one-out prediction on trials made up so that the answer is known."""

import numpy as np
import pytest

from learning.scores import auroc
from learning.trials import PredictionParams, Trial, leave_one_out, load_trials


def made_up(rng, aimed_at):
    """An object flies to one of two taxels 12 cm apart, 10 cm/s, head on to that one."""
    taxels = np.array([[-0.06, 0, 0], [0.06, 0, 0]])
    stamps = 0.1 * np.arange(20)
    height = 0.1 * (stamps[-1] - stamps) + 0.001
    p = taxels[aimed_at] + np.stack([0 * height, 0 * height, height], 1) + rng.normal(0, 0.002, (20, 3))
    v = np.tile([0.0, 0.0, -0.1], (20, 2, 1))
    return Trial(stamps, p[:, None] - taxels, v, np.arange(2) == aimed_at)


def write(path, trials, **changes):
    offsets = np.cumsum([0] + [len(t.stamps_s) for t in trials for _ in range(2)])
    data = {
        "position_m": np.concatenate([t.d_m[:, k] for t in trials for k in range(2)]),
        "velocity_m_s": np.concatenate([t.v_m_s[:, k] for t in trials for k in range(2)]),
        "offsets": offsets,
        "outcome": np.array([np.where(t.touched, 1, -1) for t in trials]),
    }
    np.savez(path, **{k: v for k, v in {**data, **changes}.items() if v is not None})


def test_what_can_be_told_apart_is_told_apart():
    rng = np.random.default_rng(0)
    result = leave_one_out(PredictionParams(), tuple(made_up(rng, i % 2) for i in range(12)))
    assert auroc(result.touched, result.probability) == 1
    np.testing.assert_allclose(result.base_rate, np.where(result.touched, 5, 6) / 11)


def test_a_trial_out_of_sight_is_given_the_base_rate():
    rng = np.random.default_rng(1)
    trials = [made_up(rng, i % 2) for i in range(6)]
    far = Trial(trials[0].stamps_s, trials[0].d_m + np.array([0, 0, 1.0]), trials[0].v_m_s, trials[0].touched)
    result = leave_one_out(PredictionParams(), (far, *trials[1:]))
    np.testing.assert_allclose(result.probability[0], result.base_rate[0])


def test_nothing_later_than_the_lead_is_used():
    rng = np.random.default_rng(2)
    trials = [made_up(rng, i % 2) for i in range(6)]
    last = trials[0]
    late = np.where(last.stamps_s[:, None, None] > last.stamps_s[-1] - 0.15, 0.02, last.d_m)
    changed = Trial(last.stamps_s, late, last.v_m_s, last.touched)
    before, after = (leave_one_out(PredictionParams(), (t, *trials[1:])).probability[0] for t in (last, changed))
    np.testing.assert_array_equal(before, after)


def test_a_trials_file_is_read_as_it_was_written(tmp_path):
    rng = np.random.default_rng(3)
    trials = [made_up(rng, i % 2) for i in range(3)]
    write(tmp_path / "trials.npz", trials)
    for trial, again in zip(trials, load_trials(tmp_path / "trials.npz"), strict=True):
        np.testing.assert_array_equal(again.d_m, trial.d_m)
        np.testing.assert_array_equal(again.touched, trial.touched)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"offsets": np.arange(3)}, "3 offsets, expected 7"),
        ({"offsets": np.array([0, 19, 40, 60, 80, 100, 120])}, "different lengths"),
        ({"outcome": None}, "expected an .npz file with"),
    ],
)
def test_a_bad_trials_file_is_refused(tmp_path, changes, message):
    rng = np.random.default_rng(4)
    write(tmp_path / "trials.npz", [made_up(rng, i % 2) for i in range(3)], **changes)
    with pytest.raises(ValueError, match=rf"trials\.npz.*{message}"):
        load_trials(tmp_path / "trials.npz")


def test_a_damaged_trials_file_is_refused(tmp_path):
    rng, path = np.random.default_rng(5), tmp_path / "trials.npz"
    write(path, [made_up(rng, i % 2) for i in range(3)])
    sound = path.read_bytes()
    # the first member's compression method, at bytes 8–9 of the file and 10–11 of its directory entry
    entry = sound.index(b"PK\x01\x02")
    for at, content in ((8, b"\x08\x00"), (8, b"\x63\x00")):
        damaged = bytearray(sound)
        damaged[at : at + 2] = damaged[entry + 10 : entry + 12] = content
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"trials\.npz: expected an \.npz file with"):
            load_trials(path)
