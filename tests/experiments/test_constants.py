"""The study of the tracker's constants: which it finds, that it changes them, and that it leaves them as they were."""

from dataclasses import replace
from pathlib import Path

import pytest

import tracking.foreground
import tracking.optical_flow
from pps_vision.experiments import constants
from pps_vision.experiments.constants import Constants, module_constants, parameters, scaled, times, with_parameter
from pps_vision.experiments.independent_cases import CASES
from tracking.tracker import TrackerParams


def test_constants_are_numbers_that_no_compiled_function_has_built_in() -> None:
    found = module_constants()
    assert found["foreground._MIN_ENCLOSED"] == tracking.foreground._MIN_ENCLOSED
    assert "kernels._MASK_VAR" not in found  # in a compiled function
    assert not any(name.startswith("track2d.") for name in found)


def test_a_constant_is_changed_wherever_it_is_imported_and_then_restored() -> None:
    users = [module for module in constants.modules() if "JITTER_S" in vars(module)]
    before = tracking.optical_flow.JITTER_S
    assert len(users) > 1
    with scaled("optical_flow.JITTER_S", 1.4):
        assert {module.JITTER_S for module in users} == {1.4 * before}
    assert {module.JITTER_S for module in users} == {before}


def test_whole_numbers_change_by_at_least_one() -> None:
    assert (times(2, 1.4), times(2, 0.7), times(10, 1.4), times(10, 0.7)) == (3, 1, 14, 7)
    assert times((0.5, 3), 1.4) == (0.7, 4)


def test_parameters_of_parts_are_changed_alone() -> None:
    params = TrackerParams()
    changed = with_parameter(params, "kalman.gate_chi2", 0.7)
    assert changed.kalman.gate_chi2 == pytest.approx(0.7 * params.kalman.gate_chi2)
    assert replace(changed, kalman=params.kalman) == params
    assert {"confirm_frames", "trigger.interval_s"} <= set(parameters(params))


def test_differences_are_means_over_the_films_in_which_both_have_a_value() -> None:
    nan = float("nan")
    before = [{"right_percent": right, "false_percent": 1.0, "covered_percent": nan} for right in (90.0, 80.0, nan)]
    after = [{"right_percent": right, "false_percent": 3.5, "covered_percent": 95.0} for right in (91.0, nan, 50.0)]
    found = constants.differences(after, before)
    assert found is not None
    assert (found["right"], found["false claims"]) == (1.0, 2.5)
    assert found["95 % ellipsoid"] != found["95 % ellipsoid"], "NaN"
    assert constants.differences(None, before) is None
    numbers = {"a.B": {"0.7": found | {"95 % ellipsoid": None}, "1.4": None}}
    (row,) = Constants().tables({"constants": numbers})[""].rows
    assert row == ["`a.B`", "+1.0", "refused", "+2.5", "refused", "–", "refused"]


def test_a_constant_without_which_nothing_is_tracked_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    """A track that needs more frames than the film has is never confirmed."""
    small = [
        replace(case, base=replace(case.base, seconds=1.6, width=320, height=240))
        for case in CASES
        if case.name == "vivid, red"
    ]
    monkeypatch.setattr(constants, "CASES", small)
    monkeypatch.setattr(constants, "FACTORS", (1.0 + 1e-9, 100.0))
    study = Constants(data=Path("no such folder"), only="confirm_frames")
    numbers = study.run()
    assert numbers["default"]["right_percent"] > 90
    never = numbers["constants"]["confirm_frames"]["100.0"]
    assert never["right"] == -numbers["default"]["right_percent"]
    assert [row[0] for row in study.tables(numbers)[""].rows] == ["`confirm_frames`"]
