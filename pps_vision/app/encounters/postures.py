"""The postures in which R's robot awaited touches, and how many touches each of its sessions had."""

from typing import Literal

import numpy as np

from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Array

SessionName = Literal["motor", "visual", "inner", "outer", "palm"]
"""motor, visual: double touches of the inner left forearm with the right index finger, felt or seen (its marker).
inner, outer, palm: a ball and a cube in turn approach the inner or outer left forearm or the right palm."""
TRIALS: dict[SessionName, int] = {"motor": 82, "visual": 45, "inner": 53, "outer": 34, "palm": 77}
"""Trials of each session (R Table 5)."""

# Arms in chain order, degrees; both eyes see the taxels aimed at.  The other arm hangs down.
_OUTER_ARM_DEG = (-29.4, 18.2, 87.2, 37.6, 39.1, -16.3, -12.2)
_PALM_ARM_DEG = (-25.6, 24.5, -19.6, 24.2, -41.1, 3.0, -16.0)
_HANGING_ARM_DEG = (0.0, 15.0, 0.0, 20.0, 0.0, 0.0, 0.0)


def start_posture(robot: Robot, session: SessionName) -> Array:
    """Return the joints (k,) rad in which the skin awaits objects: within sight of both eyes."""
    q = home(robot)
    arms = {"outer": (_OUTER_ARM_DEG, _HANGING_ARM_DEG), "palm": (_HANGING_ARM_DEG, _PALM_ARM_DEG)}.get(session, ())
    for side, degrees in zip(("left", "right"), arms, strict=False):
        q[robot.indices(robot.names.arm(side))] = np.deg2rad(degrees)
    return q
