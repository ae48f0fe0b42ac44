"""Adversarial tracks, stamps and postures against the control."""

from dataclasses import replace

import numpy as np
import pytest
from adversary import STARTS, attack
from data import SEED

from control import limits
from pps_vision.robot.self_collision import SelfCollision


@pytest.mark.parametrize(("steps", "episode"), [(1200, 60), pytest.param(40_000, 400, marks=pytest.mark.long)])
def test_no_limit_is_left_and_only_bad_input_is_refused(steps, episode):
    result = attack(steps, SEED, episode)
    assert result.faults == []
    assert set(result.modes) == {"idle", "avoid", "reach", "hold", "return"}
    assert {"pipeline", "arm", "posture"} <= set(result.refused)
    assert result.refused.total() < 0.5 * result.steps
    assert set(result.starts) == set(STARTS)
    assert result.sudden_stops < 0.01 * result.steps
    assert result.smallest_distance_mm >= 19.99
    assert result.freed > 0 or steps < 10_000


def test_the_attack_finds_what_the_arm_and_the_last_stage_prevent(monkeypatch):
    checked = limits.limit

    def only_stamped(params, bodies, posture, wanted, *last):
        return replace(checked(params, bodies, posture, wanted, *last), dq_rad_s=wanted.dq_rad_s)

    monkeypatch.setattr(limits, "limit", only_stamped)
    monkeypatch.setattr(SelfCollision, "parting", lambda *_: (np.empty(0), np.empty((0, 7))))
    faults = " ".join(attack(600, 1, 40).faults)
    for fault in ("joint limits left", "acceleration limit left", "self-collision distance"):
        assert fault in faults
