"""Adversarial tracks, stamps and postures against the control, also of a robot that obeys or reports late."""

import pytest
from adversary import STARTS, attack
from data import SEED
from late_robot import attack_late


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


@pytest.mark.parametrize(
    ("timing", "steps", "episode"),
    [
        *((timing, 250, 50) for timing in ("encoders one frame old", "100 ms late", "100 ms early")),
        *(pytest.param(timing, 10_000, 100, marks=pytest.mark.long) for timing in LATE),
    ],
)
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
