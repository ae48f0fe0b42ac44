"""Whether eyes that follow a motion can see it: what is shown to them must be worth showing."""

import numpy as np

from control.fixation import gaze_at
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.motions import Motion

_MARGIN_PX = 25.0
_NEAREST_M = 0.22  # nearer than that the eyes hardly converge and a toy fills the view


def can_follow(robot: Robot, rig: StereoRig, q_rad: Array, motion: Motion, seconds: float) -> bool:
    """Whether both eyes, turned as far as they can to each of nine points of the path, see it and it is
    not too near."""
    for t in np.linspace(0, seconds, 9):
        p, _ = motion(float(t))
        view = rig.view(gaze_at(robot, q_rad, p))
        for eye in (view.left, view.right):
            if not eye.sees(p, _MARGIN_PX) or np.linalg.norm(p - eye.center) < _NEAREST_M:
                return False
    return True
