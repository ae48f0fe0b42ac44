"""Fixation of targets: settling, following with and without knowledge of the motion, and search."""

import pytest

from pps_vision.experiments import fixation
from pps_vision.experiments.fixation import Condition, Fixation, _Robot


@pytest.fixture(scope="module")
def eyes() -> _Robot:
    return _Robot()


def test_six_joints_settle_and_follow_best_where_they_know_the_motion(
    eyes: _Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fixation, "_STATIC_S", 1.25)
    study = Fixation(seed=3, n=1, seconds=1.4)
    settled = study._static(eyes, "six joints")
    assert 0 < settled["eyes_s"][0] <= 0.75
    late = Condition().at("latency", 150)
    names = ("six joints, motion known", "six joints", "six joints, latency ignored")
    rms = [study._moving(eyes, name, late, ("circle",))["rms_deg"][0] for name in names]
    assert rms == sorted(rms)
    assert rms[0] < 0.3 < rms[2]


def test_the_covering_search_finds_all_points_and_the_random_one_does_not(
    eyes: _Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fixation, "_FOUND_S", (1.0, 4.0, 15.0))
    result = Fixation(seed=3, n=1)._search(eyes)
    for shares in result.values():
        values = [share[0] for share in shares.values()]
        assert values == sorted(values)
        assert 0 <= values[0] < values[-1] <= 100
    assert result["covering"]["15 s"][0] == 100
    assert result["random"]["15 s"][0] < 100
