"""The robot's own fingertip in place of a tracked object (R, double touch): the joints tell where it is, eyes off."""

import numpy as np

from control.double_touch import FINGERTIP_RADIUS_M
from control.limits import MAX_HOLD_S
from pps_vision.app.pipeline import joints_of
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

_JOINTS_STD_M = 1e-3  # fingertip position by the joints; ten times that for its velocity, m/s


class FingertipTracker:
    """Stands in for `Tracker` in a `Pipeline`: the joints of each frame give position and velocity of the right index
    finger's tip.

    The images are not used: from joints and skin alone, the robot learns from self-touch and avoids its own finger.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last: tuple[float, Array] | None = None

    def step(self, frame: StereoFrame) -> TrackerStep:
        """Return the fingertip's track, its velocity from the last frame; unknown in the first frame and after a gap of
        0.5 s."""
        tip = np.asarray(self._robot.at(joints_of(frame)).point(self._robot.names.index_tips[1]))
        last, self._last = self._last, (frame.stamp_s, tip)
        track = Track3D.unknown(frame.stamp_s)
        if last is not None and 0 < frame.stamp_s - last[0] <= MAX_HOLD_S:
            mean = np.array([tip, (tip - last[1]) / (frame.stamp_s - last[0]), np.zeros(3), np.zeros(3)])
            std = _JOINTS_STD_M * np.repeat([1.0, 10.0, 0.0, 0.0], 3)
            track = Track3D(frame.stamp_s, mean, np.diag(std**2), FINGERTIP_RADIUS_M, 1e-8, Status.TRACKING)
        return TrackerStep(track, (), None, np.zeros(3))
