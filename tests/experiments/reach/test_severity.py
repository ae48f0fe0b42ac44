"""Severity study in small: no disturbance changes nothing, the worst break the map, and J's method breaks first."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_study import run_and_draw

from pps_vision.experiments.reach import severity
from pps_vision.experiments.reach.map_truth import first
from pps_vision.experiments.reach.severity import (
    DISTURBANCES,
    LEARNERS,
    Severity,
    Training,
    disturbed,
    learn_and_judge,
)


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(severity, "_PARAMS", replace(severity._PARAMS, lattice=0.12, n_babble=5000))


def test_first_severity_changes_nothing_and_last_does() -> None:
    data = Training.undisturbed(3, 10)
    for name, (axis, _) in DISTURBANCES.items():
        none, worst = (disturbed(name, 10, 3, axis.severities[k]) for k in (0, -1))
        np.testing.assert_array_equal(none.babbled.arm_rad, data.babbled.arm_rad, err_msg=name)
        np.testing.assert_allclose(none.babbled.gaze_rad, data.babbled.gaze_rad, err_msg=name)
        assert none.flipped == 0
        same_size = worst.babbled.arm_rad.shape == data.babbled.arm_rad.shape
        same = same_size and np.allclose(worst.babbled.arm_rad, data.babbled.arm_rad)
        same = same and np.allclose(worst.babbled.gaze_rad, data.babbled.gaze_rad)
        assert not same or worst.flipped > 0, name


def test_a_quarter_of_outliers_breaks_the_paper_method_but_not_ours() -> None:
    data = disturbed("another object fixated", 500, 3, 25)
    ours, of_j = (np.mean(learn_and_judge(name, 200, data, 3)["misjudged"]) for name in LEARNERS)
    assert ours < 0.05
    assert ours < 0.5 * of_j


@pytest.mark.parametrize(("disturbance", "level"), [("elbow encoder stuck", 100), ("fewer samples", 12)])
def test_past_the_break_every_posture_still_has_a_verdict(disturbance: str, level: float) -> None:
    data = disturbed(disturbance, 500, 3, level)
    data = replace(data, babbled=first(data.babbled, 600))
    for learner in LEARNERS:
        values = learn_and_judge(learner, 200, data, 3)
        assert len(values["misjudged"]) == len(data.gaze_rad)
        assert np.mean(values["misjudged"]) > 0.05


@pytest.mark.long
def test_study_finds_the_break_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """40 % of the labels are reversed."""
    cases = {"labels flipped": (0, 40)}
    chosen = {name: (DISTURBANCES[name][0]._replace(severities=s), DISTURBANCES[name][1]) for name, s in cases.items()}
    monkeypatch.setattr(severity, "DISTURBANCES", chosen)
    study = Severity(5, n=1, n_labels=100, n_test=500)
    numbers, _ = run_and_draw(study)
    for (name, (_, worst)), row in zip(cases.items(), study.tables(numbers)[""].rows, strict=True):
        ours = numbers[name]["methods"]["ours"]
        assert ours["je"][1][0] > ours["je"][0][0] + 3
        assert ours["breaks_at"] in (0, worst)
        assert row[2] == f"{ours['breaks_at']:g}"
