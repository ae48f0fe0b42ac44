"""The iCub: its description, its calibrated eyes, its encoders' order and the home posture."""

from importlib.resources import as_file, files

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.robot.model import FrameNames, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array

# Eye calibration at 320×240 of the robot behind R (its icubEyes.ini).
LEFT_EYE = Camera(320, 240, 219.057, 219.028, 174.742, 102.874, (-0.374173, 0.205428, 0.00282356, 0.00270998, 0.0))
RIGHT_EYE = Camera(320, 240, 225.904, 227.041, 157.858, 113.51, (-0.377318, 0.155149, -0.000726514, 0.000317338, 0.0))

# Encoder order on the robot, degrees; "-": no joint of the model.  The torso's motor order is the reverse of its chain.
_ARM = FrameNames().arm
PORTS = {
    "torso": ("torso_yaw", "torso_roll", "torso_pitch"),
    "head": ("neck_pitch", "neck_roll", "neck_yaw", "eyes_tilt", "version", "vergence"),
    "left_arm": (*_ARM("left"), *("-",) * 9),  # the fingers
    "right_arm": (*_ARM("right"), *("-",) * 9),
}

# Left arm at home (shoulder to wrist): the palm is at (−.30, −.20, .05) m and the inner forearm in view.
HOME_ARM_DEG = (-30.3, 22.9, -8.5, 50.7, -45.9, 0.0, 0.0)
HOME_ARM_RAD = tuple(float(a) for a in np.deg2rad(HOME_ARM_DEG))


def load_icub() -> Robot:
    """The iCub's upper body, from the package's URDF."""
    with as_file(files("pps_vision.robot") / "icub.urdf") as urdf:
        return Robot(urdf)


def icub_rig(robot: Robot, left: Camera = LEFT_EYE, right: Camera = RIGHT_EYE) -> StereoRig:
    """The robot's eyes: calibrated cameras that move with its joints."""
    return StereoRig(left, right, robot.eye_poses)


def icub_setup(skin: Skin | None = None) -> RobotSetup:
    """The iCub with its virtual taxels (default: all), at home."""
    robot = load_icub()
    return RobotSetup(robot, icub_rig(robot), skin or icub_skin(), home(robot), PORTS, ("head",))


def home(robot: Robot) -> Array:
    """Both arms at home, eyes ahead and slightly converged, rad."""
    q = np.zeros(robot.n_joints)
    for side in ("left", "right"):
        q[robot.indices(robot.names.arm(side))] = HOME_ARM_RAD
    return set_gaze(robot, q, vergence=np.deg2rad(10.0))


def set_gaze(
    robot: Robot,
    q: ArrayLike,
    yaw: float | None = None,
    pitch: float | None = None,
    tilt: float | None = None,
    version: float | None = None,
    vergence: float | None = None,
) -> Array:
    """A copy of `q` with the named gaze angles (rad) replaced; pan left/right = version ± vergence/2."""
    q_new = np.array(q, dtype=float)
    *neck, i_left, i_right = robot.indices(robot.names.gaze_joints)
    for index, value in zip(neck, (yaw, pitch, tilt), strict=True):
        if value is not None:
            q_new[index] = value
    version = 0.5 * (q_new[i_left] + q_new[i_right]) if version is None else version
    vergence = q_new[i_left] - q_new[i_right] if vergence is None else vergence
    q_new[[i_left, i_right]] = version + vergence / 2, version - vergence / 2
    return q_new
