"""Adversarial tracks, stamps and postures against the control; at length in `bench adversarial_control`."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from control import limits
from pps_vision.experiments.adversarial_control import STARTS, attack
from pps_vision.robot.self_collision import SelfCollision


def test_no_limit_is_left_and_nothing_but_input_is_refused() -> None:
    found = attack(1200, SEED, 60)
    assert found.faults == []
    assert set(found.modes) == {"idle", "avoid", "reach", "hold", "return"}
    assert {"pipeline", "avoidance", "posture"} <= set(found.refused)
    assert found.refused.total() < 0.5 * found.steps
    assert set(found.starts) == set(STARTS)
    assert found.sudden_stops < 0.01 * found.steps


def test_the_attack_finds_what_the_arm_and_the_last_stage_prevent(monkeypatch: pytest.MonkeyPatch) -> None:
    checked = limits.limit

    def only_stamped(params, bodies, posture, wanted, *last):  # type: ignore[no-untyped-def]
        return replace(checked(params, bodies, posture, wanted, *last), dq_rad_s=wanted.dq_rad_s)

    monkeypatch.setattr(limits, "limit", only_stamped)
    monkeypatch.setattr(SelfCollision, "parting", lambda *_: (np.empty(0), np.empty((0, 7))))
    faults = " ".join(attack(600, 1, 40).faults)
    for fault in ("joint limits left", "acceleration limit left", "self-collision distance"):
        assert fault in faults
