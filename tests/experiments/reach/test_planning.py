"""Planning with the torso in small: reachable objects are touched, the others refused."""

from dataclasses import replace

import pytest
from data import SEED
from drawn_study import run_and_draw

from pps_vision.experiments.reach import planning
from pps_vision.experiments.reach.planning import Planning


def test_what_the_torso_brings_into_reach_is_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "_PARAMS", replace(planning._PARAMS, lattice=0.08, n_babble=10_000))
    study = Planning(SEED, n=3, n_labels=1000)
    numbers, _ = run_and_draw(study)
    possible = numbers["reachable_with_torso"]
    assert numbers["touched"] >= possible - 1
    assert numbers["refused_rightly"] >= 3 - possible
    assert numbers["fixation_within_2_deg"] == numbers["touched"]
    assert numbers["beyond_limits_deg"] == pytest.approx(0, abs=0.1)


def test_no_object_is_an_error() -> None:
    with pytest.raises(ValueError, match="n 0"):
        Planning(n=0).run()
