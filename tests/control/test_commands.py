"""One command from several controllers, and where a robot that obeys late will be, against a clock with small ticks."""

import numpy as np
import pytest

from control.commands import combine, posture_after
from pps_vision.types import JointVelocity


def command(*rates: float, stamp_s: float = 0.5, hold_s: float = 0.4) -> JointVelocity:
    return JointVelocity(stamp_s, np.array(rates), hold_s)


def test_disjoint_commands_are_added():
    combined = combine([command(0.1, 0.0, -0.2), command(0.0, 0.3, 0.0)])
    np.testing.assert_array_equal(combined.dq_rad_s, [0.1, 0.3, -0.2])
    assert (combined.stamp_s, combined.hold_s) == (0.5, 0.4)
    np.testing.assert_array_equal(combine([command(0.1, 0.0)]).dq_rad_s, [0.1, 0.0])


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ([command(0.1, 0.2), command(0.0, -0.2)], r"joints \[1\] are commanded twice"),
        ([command(0.1, 0.0), command(0.0, 0.2, stamp_s=0.6)], r"validities \[\(0.5, 0.4\), \(0.6, 0.4\)\]"),
        ([command(0.1, 0.0), command(0.0, 0.2, hold_s=0.3)], r"validities \[\(0.5, 0.3\), \(0.5, 0.4\)\]"),
        ([command(0.1, 0.0), command(0.0)], r"shapes \[\(1,\), \(2,\)\]"),
        ([command(0.1, np.nan)], "expected finite"),
        ([], r"expected one of each"),
    ],
)
def test_commands_that_do_not_combine_are_refused(commands, message):
    with pytest.raises(ValueError, match=message):
        combine(commands)


@pytest.mark.parametrize("latency_s", [0.0, 0.03, 0.1, 0.23])
def test_the_commands_on_the_way_are_obeyed_in_turn(rng, latency_s):
    stamps = np.cumsum(rng.uniform(0.02, 0.2, 6))
    commands = [JointVelocity(float(t), rng.normal(size=3), 0.1) for t in stamps]  # some end before the next
    q0 = rng.normal(size=3)
    from_s = 0.11
    until_s = 0.9
    expected = q0.copy()
    ticks = np.arange(from_s, until_s, 1e-4)
    for t in ticks:
        begun = [c for c in commands if c.stamp_s + latency_s <= t]
        if begun and t < begun[-1].stamp_s + latency_s + begun[-1].hold_s:
            expected += 1e-4 * begun[-1].dq_rad_s
    np.testing.assert_allclose(posture_after(q0, commands, from_s, until_s, latency_s), expected, atol=2e-3)


def test_nothing_moves_in_no_time_or_without_commands():
    q = np.arange(3.0)
    command = JointVelocity(0.0, np.ones(3), 0.5)
    np.testing.assert_array_equal(posture_after(q, [command], 0.2, 0.2, 0.0), q)
    np.testing.assert_array_equal(posture_after(q, [], 0.0, 1.0, 0.0), q)
    np.testing.assert_array_equal(posture_after(q, [command], 0.5, 1.0, 0.0), q)
