"""Planning with the torso, briefly: what the full bench says of many objects, said of few."""

from functools import partial

import pytest
from data import SEED

from learning.reach.training import MapParams
from pps_vision.experiments.reach import planning_world
from pps_vision.experiments.reach.planning import Planning


def test_what_can_be_brought_into_reach_is_touched(monkeypatch):
    monkeypatch.setattr(planning_world, "MapParams", partial(MapParams, lattice=0.08, n_babble=10_000))
    experiment = Planning(SEED, n=3, n_labels=1000, turns=(40,))
    numbers = experiment.run()
    can = numbers["within_reach_of_some_torso_posture"]
    assert numbers["touched"] >= can - 1
    assert numbers["said_out_of_reach_rightly"] >= 3 - can
    assert numbers["held_within_2_deg"] == numbers["touched"]
    assert numbers["beyond_joint_limits_deg"] == pytest.approx(0, abs=0.1)
    assert numbers["relation"][0]["rms_deg"] < 0.7 * numbers["relation"][0]["no_relation_rms_deg"]
    experiment.chart(numbers)


def test_no_object_is_no_experiment():
    with pytest.raises(ValueError, match="--n 0"):
        Planning(n=0).run()
