"""Fixation of targets: settling, following with and without knowledge of the motion, and search."""

import pytest

from pps_vision.experiments.fixation import AXES, Fixation, Head

STUDY = Fixation(seed=3, n=1, seconds=1.4)


@pytest.fixture(scope="module")
def head() -> Head:
    return Head()


def test_six_joints_settle_and_follow_best_where_they_know_the_motion(head):
    assert 0 < STUDY.settle(head, "six joints")["eyes_s"][0] <= 0.75
    late = AXES["latency"][1][150]
    names = ("six joints, motion known", "six joints", "six joints, latency ignored")
    rms = [STUDY.follow(head, name, late, ("circle",))["rms_deg"][0] for name in names]
    assert rms == sorted(rms)
    assert rms[0] < 0.3 < rms[2]


def test_the_covering_search_finds_all_points_and_the_random_one_does_not(head):
    covering = [share[0] for share in STUDY.search(head, "covering").values()]
    random = [share[0] for share in STUDY.search(head, "random").values()]
    assert covering == sorted(covering)
    assert covering[-1] == 100
    assert random == sorted(random)
    assert 0 <= random[-1] < 100
