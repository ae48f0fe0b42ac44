"""R's sessions in small, known exactly: what the figures say of them."""

import numpy as np
import pytest
from data import SEED

from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.experiments.pps import double_touches, sessions
from pps_vision.experiments.pps.double_touches import DoubleTouches
from pps_vision.experiments.pps.landscapes import NAMES, Landscapes
from pps_vision.experiments.pps.progress import Progress, neighbours
from pps_vision.experiments.pps.sessions import session
from pps_vision.experiments.pps.table5 import PAPER, Table5
from pps_vision.experiments.pps.touch_movements import TRIALS
from pps_vision.robot.icub import load_icub


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Two trials a session."""
    monkeypatch.setattr(sessions, "TRIALS", dict.fromkeys(TRIALS, 2))


def test_as_many_trials_as_the_paper():
    assert {name: of["trials"] for name, of in PAPER.items()} == TRIALS


def test_samples_are_the_steps_in_which_some_taxel_perceives(tmp_path):
    made = session("inner", SEED, False, tmp_path)
    numbers = Table5(seed=SEED, trials=tmp_path, seen=False).run()["inner"]["ours"]
    robot, n = load_icub(), 0
    for trial in made.trials:
        for k, q in enumerate(trial.joints_rad):
            D, _ = perceive(ReceptiveField(), *made.skin.at(robot.at(q)), trial.positions[k], trial.velocities[k])
            n += bool(np.isfinite(D).any())
    assert numbers["samples"] == n
    assert numbers["minutes"] == pytest.approx(sum(trial.stamps_s[-1] for trial in made.trials) / 60, abs=0.006)


def test_landscapes_of_all_five_sessions(tmp_path):
    experiment = Landscapes(seed=SEED, trials=tmp_path, seen=False, resampled=20, robots=2)
    numbers = experiment.run()
    assert list(numbers) == list(NAMES)
    for name, of in numbers.items():
        assert of["trials"] == 2
        assert of["taxel"].startswith("right_palm" if name == "palm" else "left_forearm")
        assert 0 <= np.min(of["activation"]) <= np.max(of["activation"]) <= 1
        low, high = of["ridge_width_95_cm"]
        assert 0 <= low <= high
        assert of["ridge_width_cm"] < 8
        assert len(of["ridge_widths_of_erring_cm"]) == 2
        assert set(of["ridge_widths_of_erring_cm"]) != {of["ridge_width_cm"]}
    assert max(np.max(of["activation"]) for of in numbers.values()) > 0.1
    assert len(experiment.chart(numbers).axes) == 7


def test_progress_from_trial_to_trial(tmp_path):
    experiment = Progress(seed=SEED, trials=tmp_path, seen=False, held_out=4)
    numbers = experiment.run()
    made = session("inner", SEED, False, tmp_path)
    first, second = neighbours(made)
    positions = made.skin.parts[0].positions_m
    assert 0.01 < np.linalg.norm(positions[first] - positions[second]) < 0.03
    after_one = np.array(numbers["landscapes"][1])
    assert len(after_one) == 2
    assert after_one.max() > 0.1
    for kinds in numbers["predicted"].values():
        for by_n in kinds.values():
            assert 0 <= by_n[53]["auroc"] <= 1
            assert 0 <= by_n[53]["calibration_error"] <= 1
    assert experiment.chart(numbers).axes


def test_a_finger_whose_joints_read_right_touches_what_it_aims_at(monkeypatch):
    monkeypatch.setattr(double_touches, "INNER_FOREARM", (27, 183))
    experiment = DoubleTouches(seed=SEED, starts=2, robots=1, joint_deg=(0.0, 4.0))
    numbers = experiment.run()
    assert all(sum(of.values()) == 2 for of in numbers["outcomes"].values())
    right, wrong = numbers["joint_errors"]
    assert right["aimed_is_touched_percent"] == 100
    assert right["gap_to_the_aimed_mm_rms"] < 0.1
    assert wrong["aimed_is_touched_percent"] < 100
    assert wrong["gap_to_the_aimed_mm_rms"] > 1
    assert experiment.chart(numbers).axes
    with pytest.raises(ValueError, match="--starts 0"):
        DoubleTouches(starts=0).run()
