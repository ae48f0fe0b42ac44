"""Adversarial tracks, stamps and postures against the control, also of a robot that obeys or reports late."""

from dataclasses import replace

import numpy as np
import pytest
from adversary import STARTS, attack
from data import SEED
from late_robot import attack_late

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


LATE = {  # stated and true latency (s), and age of the encoders' readings (frames)
    "encoders one frame old": (0.0, 0.0, 1),
    "50 ms late": (0.0, 0.05, 0),
    "100 ms late": (0.0, 0.1, 0),
    "50 ms early": (0.1, 0.05, 0),
    "100 ms early": (0.1, 0.0, 0),
}


@pytest.mark.parametrize(("steps", "episode"), [(250, 50), pytest.param(10_000, 100, marks=pytest.mark.long)])
@pytest.mark.parametrize("timing", LATE)
def test_a_robot_that_obeys_or_reports_late_keeps_its_limits_and_is_reported(timing, steps, episode):
    result = attack_late(steps, SEED, episode, *LATE[timing])
    assert result.faults == []
    assert result.limits_left == 0
    assert result.smallest_distance_mm >= 18.0
    assert result.unsaid == result.said_in_vain == []
    assert len(result.said_after_s) > 0.6 * result.starts.total()
    assert max(result.said_after_s) <= 1.0


@pytest.mark.parametrize("latency_s", [0.0, 0.1])
def test_a_robot_with_the_stated_latency_is_not_reported(latency_s):
    result = attack_late(250, SEED, 50, latency_s, latency_s, 0)
    assert result.faults == result.said_in_vain == result.said_after_s == []
    assert result.limits_left == 0
    assert result.modes["avoid"] > 0


@pytest.mark.long
def test_the_attack_finds_limits_that_the_reported_posture_alone_does_not_keep(monkeypatch):
    checked = limits.limit
    monkeypatch.setattr(limits, "limit", lambda *args: checked(*args[:5]))
    result = attack_late(250, SEED, 50, *LATE["encoders one frame old"])
    assert result.limits_left > 0
    assert np.rad2deg(result.beyond_rad) > 1.0


@pytest.mark.long
def test_the_attack_finds_what_the_arm_and_the_last_stage_prevent(monkeypatch):
    checked = limits.limit

    def only_stamped(params, bodies, posture, wanted, *last):
        return replace(checked(params, bodies, posture, wanted, *last), dq_rad_s=wanted.dq_rad_s)

    monkeypatch.setattr(limits, "limit", only_stamped)
    monkeypatch.setattr(SelfCollision, "parting", lambda *_: (np.empty(0), np.empty((0, 7))))
    faults = " ".join(attack(1200, 3, 60).faults)
    for fault in ("joint limits left", "acceleration limit left", "self-collision distance"):
        assert fault in faults
