"""Combine the commands of the arm and gaze controllers into one command for the whole robot."""

from collections.abc import Sequence

import numpy as np

from pps_vision.types import JointVelocity


def combine(commands: Sequence[JointVelocity]) -> JointVelocity:
    """The sum of velocity commands that move disjoint sets of joints.

    Args:
        commands: at least one, all of the same stamp and length.

    Returns:
        One command (n_joints,) rad/s; each controller has kept its own limits, so the sum keeps them.

    Raises:
        ValueError: two commands move one joint, their stamps or lengths differ, or a rate is not finite.
    """
    stamps, shapes = {c.stamp_s for c in commands}, {c.dq_rad_s.shape for c in commands}
    if len(stamps) != 1 or len(shapes) != 1:
        raise ValueError(f"commands of stamps {sorted(stamps)} s and shapes {sorted(shapes)}; expected one of each")
    rates = np.array([c.dq_rad_s for c in commands])
    if not np.isfinite(rates).all():
        raise ValueError(f"joint rates {rates}: expected finite numbers in rad/s")
    shared = np.flatnonzero(np.count_nonzero(rates, axis=0) > 1)
    if shared.size:
        raise ValueError(f"joints {shared.tolist()} are commanded twice; expected disjoint sets of joints")
    return JointVelocity(stamps.pop(), rates.sum(axis=0))
