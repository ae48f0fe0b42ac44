"""Where a robot's eyes look."""

from pps_vision.geometry.triangulation import midpoint
from pps_vision.robot.model import Posture
from pps_vision.types import Array


def fixation_point(posture: Posture) -> Array:
    """(3,) m where the optical axes meet, root frame."""
    left = posture.T_root("left_eye")
    right = posture.T_root("right_eye")
    meeting = midpoint(left[:3, 3], left[:3, 2], right[:3, 3], right[:3, 2])
    assert meeting is not None
    return meeting
