"""One command from several controllers, which move disjoint sets of joints."""

import numpy as np
import pytest

from control.commands import combine
from pps_vision.types import JointVelocity


def command(*rates: float, stamp_s: float = 0.5, hold_s: float = 0.4) -> JointVelocity:
    return JointVelocity(stamp_s, np.array(rates), hold_s)


def test_disjoint_commands_are_added():
    combined = combine([command(0.1, 0.0, -0.2), command(0.0, 0.3, 0.0)])
    np.testing.assert_array_equal(combined.dq_rad_s, [0.1, 0.3, -0.2])
    assert (combined.stamp_s, combined.hold_s) == (0.5, 0.4)


def test_one_command_stays_as_it_is():
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
