"""Leaning in small: reachable objects are touched, the others refused."""

from dataclasses import replace

import pytest
from data import SEED
from drawn_study import run_and_draw

from pps_vision.experiments.reach import lean
from pps_vision.experiments.reach.lean import Lean


def test_what_leaning_brings_into_reach_is_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lean, "_PARAMS", replace(lean._PARAMS, lattice=0.08, n_babble=10_000))
    numbers, _ = run_and_draw(Lean(SEED, n=8, n_labels=1000))
    possible = numbers["reachable_with_torso"]
    assert 2 <= possible <= 6
    assert numbers["touched"] >= possible - 1
    assert numbers["refused_rightly"] == 8 - possible
    assert numbers["fixation_error_deg"][2] < 0.5 * numbers["fixation_error_reacting_deg"][0]
