"""Sum of the commands of the arm and gaze controllers, and the posture that earlier commands lead to."""

from collections.abc import Sequence

import numpy as np

from pps_vision.errors import InputError
from pps_vision.types import Array, JointVelocity


def combine(commands: Sequence[JointVelocity]) -> JointVelocity:
    """The sum of one or more velocity commands that move disjoint sets of joints, not yet within limits.

    InputError if two commands move one joint, their stamps, validities or lengths differ, or a rate is not finite.
    """
    times = {(command.stamp_s, command.hold_s) for command in commands}
    shapes = {command.dq_rad_s.shape for command in commands}
    if len(times) != 1 or len(shapes) != 1:
        differing = f"stamps and validities {sorted(times)} s and shapes {sorted(shapes)}"
        raise InputError("arbiter", f"commands of {differing}; expected one of each")
    rates = np.array([command.dq_rad_s for command in commands])
    if not np.isfinite(rates).all():
        raise InputError("arbiter", f"joint rates {rates}; expected finite numbers in rad/s")
    shared = np.flatnonzero(np.count_nonzero(rates, axis=0) > 1)
    if shared.size:
        raise InputError("arbiter", f"joints {shared.tolist()} are commanded twice; expected disjoint sets of joints")
    stamp_s, hold_s = times.pop()
    return JointVelocity(stamp_s, rates.sum(axis=0), hold_s)


def posture_after(q: Array, commands: Sequence[JointVelocity], from_s: float, to_s: float, latency_s: float) -> Array:
    """The configuration (n_joints,) at `to_s` of a robot at `q` at `from_s` that obeys `commands`.

    Each of the commands, in order of stamps, takes effect `latency_s` later, until the next one does or it expires.
    """
    for k, command in enumerate(commands):
        begin = command.stamp_s + latency_s
        end = begin + command.hold_s
        if k + 1 < len(commands):
            end = min(end, commands[k + 1].stamp_s + latency_s)
        obeyed_s = min(end, to_s) - max(begin, from_s)
        if obeyed_s > 0:
            q = q + obeyed_s * command.dq_rad_s
    return q
