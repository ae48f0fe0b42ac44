"""Studies of R's sessions, small and with exactly known objects."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw

from control.double_touch import DoubleTouch, DoubleTouching
from learning.pps.memory import MemoryParams
from learning.pps.receptive_field import ReceptiveField, perceive
from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps import compensation, double_touches, landscapes, offsets
from pps_vision.experiments.pps.calibration import Calibration
from pps_vision.experiments.pps.compensation import Compensation
from pps_vision.experiments.pps.double_touches import DoubleTouches
from pps_vision.experiments.pps.invariance import Invariance, in_other_posture
from pps_vision.experiments.pps.landscapes import TITLES, Landscapes
from pps_vision.experiments.pps.movements import TRIALS, SessionName
from pps_vision.experiments.pps.offsets import Offsets
from pps_vision.experiments.pps.perceived import Session, in_taxel_frames, train_memory
from pps_vision.experiments.pps.perceived import perceive as perceive_trial
from pps_vision.experiments.pps.robot_errors import SOURCES
from pps_vision.experiments.pps.table5 import PAPER, Table5
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import icub_skin

ROBOT, FOREARM = load_icub(), icub_skin(("left_forearm",))


@pytest.fixture
def not_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact trials in place of rendered ones."""

    def exact(name: SessionName, n: int, seed: int, folder: Path) -> tuple[TouchTrial, ...]:
        return exact_trials(name, n, seed)

    monkeypatch.setattr("pps_vision.experiments.pps.trials.rendered_trials", exact)


@pytest.mark.usefixtures("not_rendered")
def test_table_5_has_the_papers_trials_and_counts_the_steps_that_are_perceived() -> None:
    assert {name: of["trials"] for name, of in PAPER.items()} == TRIALS
    numbers, _ = run_and_draw(Table5(SEED, share=2 / 53))
    n = 0
    for trial in exact_trials("inner", 2, SEED):
        for q, p, v in zip(trial.joints_rad, trial.positions, trial.velocities, strict=True):
            n += bool(np.isfinite(perceive(ReceptiveField(), *FOREARM.at(ROBOT.at(q)), p, v)[0]).any())
    assert numbers["sessions"]["inner"]["ours"]["samples"] == n


def test_a_session_shows_the_taxel_aimed_at_with_the_most_samples() -> None:
    session = Session.of("outer", exact_trials("outer", 3, SEED))
    memory = train_memory(session.trials, MemoryParams(bins=(1, 1)))
    shown = session.shown_taxel(memory)
    assert session.name(shown) in {f"left_forearm:{i}" for i in (87, 75, 39, 51)}
    assert memory.counts[shown].sum() == memory.counts[8:].sum(axis=(1, 2, 3)).max()  # outer taxels come last


@pytest.mark.usefixtures("not_rendered")
def test_landscapes_of_all_sessions() -> None:
    numbers, charts = run_and_draw(Landscapes(SEED, n=2, share=2 / 53))
    assert list(numbers["sessions"]) == list(TITLES)
    for name, of in numbers["sessions"].items():
        assert of["taxel"].startswith("right_palm" if name == "palm" else "left_forearm")
        assert 0 <= np.min(of["activation"]) <= np.max(of["activation"]) <= 1
        width, low, high = of["ridge_width_cm"]
        assert 0 <= low <= high < 8
        assert of["ridge_width_erring_cm"][0] != width
    assert len(numbers["fig9"]) == 2 * len(landscapes.AFTER)
    pair = {FOREARM.index(title.split(",")[0]) for title in numbers["fig9"]}
    assert np.linalg.norm(np.subtract(*FOREARM.parts[0].positions_m[list(pair)])) < 0.03  # neighbours
    wrist = numbers["wrist"]
    assert len(wrist["taxels"]) == len(wrist["mean_activation"]) == 8
    nearer = [of for _, of in sorted(zip(wrist["from_palm_cm"], wrist["taxels"], strict=True))]
    along = [FOREARM.parts[0].positions_m[FOREARM.index(name)][1] for name in nearer]  # the wrist is at y = 0
    assert np.corrcoef(along, np.arange(8))[0, 1] < -0.9
    assert -1 <= wrist["rank_correlation"] <= 1
    assert set(charts) == {"", "ridge", "fig9"}


def test_a_finger_without_encoder_offsets_touches_the_aimed_taxel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(double_touches, "INNER_FOREARM", (27, 183))
    monkeypatch.setattr(double_touches, "ENCODER_DEG", (0.0, 4.0))
    numbers, _ = run_and_draw(DoubleTouches(SEED, starts=2, n=1))
    assert all(of in (0, 50, 100) for of in numbers["feasible_percent"].values())
    without, off = numbers["aimed_is_touched_percent"].values()
    assert without[0] == 100
    assert off[0] < 100


def test_a_finger_on_its_way_touches_no_taxel_and_then_the_aimed_one() -> None:
    planner = DoubleTouching(ROBOT, FOREARM.parts[0])
    plans = planner.plan(0, 8, np.random.default_rng(SEED))
    touch = next(plan for plan in plans if isinstance(plan, DoubleTouch))
    assert double_touches.first_touched(planner, touch.joints_rad[:5]) == len(FOREARM.taxel_ids)
    assert double_touches.first_touched(planner, touch.joints_rad) == 0


def test_offsets_of_an_erring_robot_are_found_within_3_mm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offsets, "PAPER_MM", {"palm": 11.6})
    monkeypatch.setattr(offsets, "TRIALS", {"palm": 12})
    numbers, _ = run_and_draw(Offsets(SEED, n=1))
    assert numbers["taxels"] >= 1
    assert numbers["methods"]["found"]["error_median_mm"][0] < 3
    assert numbers["parts"]["palm"]["true_mm"] > 0


@pytest.mark.usefixtures("not_rendered")
def test_calibration_is_drawn() -> None:
    study = Calibration(SEED, share=0.3)
    numbers, _ = run_and_draw(study)
    (goal_met,) = {row[-1] for row in study.tables(numbers)[""].rows if row[0] == "base rate"}
    assert goal_met == "no"  # it does not discriminate within a taxel
    assert all(0 <= of["scores"]["brier"][0] <= 1 for of in numbers["methods"].values())


def test_in_another_posture_the_skin_perceives_the_same() -> None:
    rng = np.random.default_rng(SEED)
    (trial,) = exact_trials("inner", 1, SEED)
    before = perceive_trial(*in_taxel_frames([trial]))
    for _ in range(5):
        moved = in_other_posture(trial, ROBOT, rng)
        assert np.abs(moved.joints_rad - trial.joints_rad).max() > np.deg2rad(5)
        assert np.all((moved.joints_rad >= ROBOT.lower_rad) & (moved.joints_rad <= ROBOT.upper_rad))
        assert np.linalg.norm(moved.positions[-1] - trial.positions[-1]) > 0.005
        for one, other in zip(before, perceive_trial(*in_taxel_frames([moved])), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6)


@pytest.mark.usefixtures("not_rendered")
def test_without_errors_posture_changes_nothing() -> None:
    numbers, charts = run_and_draw(Invariance(SEED, n=1, share=0.14))
    without = numbers["postures"]["no errors"]
    assert without["home → home"]["brier"] == pytest.approx(without["home → others"]["brier"], abs=1e-6)
    assert set(charts) == {"postures", "modalities"}


def test_each_case_is_trained_and_tested_on_its_own_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    sets = ("perfect training", "perfect test"), ("erring training", "erring test"), ("training", "test")
    found = compensation.cases(*sets)  # type: ignore[arg-type]
    assert found == {
        "no errors": sets[0],
        "errors, map trained without": ("perfect training", "erring test"),
        "errors, map trained with": sets[1],
        "encoder offsets estimated too": sets[2],
    }
    monkeypatch.setattr(compensation, "TRIALS", {"inner": 6})
    monkeypatch.setattr(compensation, "SOURCES", {"cameras": SOURCES["cameras"]})
    numbers, charts = run_and_draw(Compensation(SEED, n=1, n_single=1))
    assert set(numbers["sources"]) == {"cameras", "all"}
    assert set(charts) == {""}
