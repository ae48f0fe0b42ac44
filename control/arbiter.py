"""Combine the commands of the arm and gaze controllers into one command for the whole robot."""

from collections.abc import Sequence

import numpy as np

from pps_vision.errors import InputError
from pps_vision.types import JointVelocity


def combine(commands: Sequence[JointVelocity]) -> JointVelocity:
    """The sum of velocity commands that move disjoint sets of joints.

    Args:
        commands: at least one, all of the same stamp, validity and length.

    Returns:
        One command (n_joints,) rad/s, which `limits.limit` takes into the robot's limits.

    Raises:
        InputError: two commands move one joint, their stamps, validities or lengths differ, or a rate is not finite.
    """
    times = {(command.stamp_s, command.hold_s) for command in commands}
    shapes = {command.dq_rad_s.shape for command in commands}
    if len(times) != 1 or len(shapes) != 1:
        message = (
            f"commands of stamps and validities {sorted(times)} s and shapes {sorted(shapes)}; expected one of each"
        )
        raise InputError("arbiter", message)
    rates = np.array([command.dq_rad_s for command in commands])
    if not np.isfinite(rates).all():
        raise InputError("arbiter", f"joint rates {rates}; expected finite numbers in rad/s")
    shared = np.flatnonzero(np.count_nonzero(rates, axis=0) > 1)
    if shared.size:
        raise InputError("arbiter", f"joints {shared.tolist()} are commanded twice; expected disjoint sets of joints")
    stamp_s, hold_s = times.pop()
    return JointVelocity(stamp_s, rates.sum(axis=0), hold_s)
