"""Predict the posture at which a command takes effect, from the commands issued earlier."""

from collections.abc import Sequence

from pps_vision.types import Array, JointVelocity


def posture_after(
    q_rad: Array, commands: Sequence[JointVelocity], from_s: float, until_s: float, latency_s: float
) -> Array:
    """The configuration (n_joints,) at `until_s` of a robot at `q_rad` at `from_s` that obeys `commands`.

    The commands are in the order of their stamps.  Each takes effect `latency_s` after its stamp and holds until the
    next one takes effect or it expires.
    """
    q = q_rad
    for k, command in enumerate(commands):
        begin = command.stamp_s + latency_s
        end = begin + command.hold_s
        if k + 1 < len(commands):
            end = min(end, commands[k + 1].stamp_s + latency_s)
        obeyed_s = min(end, until_s) - max(begin, from_s)
        if obeyed_s > 0:
            q = q + obeyed_s * command.dq_rad_s
    return q
