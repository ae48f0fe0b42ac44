"""A robot as the programs use it: kinematics, cameras, skin, home posture and encoders."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array


@dataclass(frozen=True)
class RobotSetup:
    """The iCub (`icub.icub_setup`), or a robot described by a robot.toml (`recordings.robot_file.read_robot`)."""

    robot: Robot  # kinematics and bodies
    rig: StereoRig  # the cameras
    skin: Skin  # all taxels
    home_rad: Array  # (n_joints,) posture at rest
    ports: Mapping[str, tuple[str, ...]]
    """The joints in the order of each port's encoders; also "version" and "vergence" of eyes that pan (their mean and
    their difference), and "-" for encoders without a joint in the model."""
    required: tuple[str, ...]  # ports that a recording must have; the others read 0 where they were not recorded

    @property
    def side(self) -> Literal["left", "right"]:
        """The "left" arm, or the "right" one of a robot without a left arm; InputError without arms."""
        if self.robot.names.left_arm:
            return "left"
        if self.robot.names.right_arm:
            return "right"
        raise InputError(self.robot.urdf, "has no arm; expected left_arm or right_arm in robot.toml")

    def home_arm(self, side: str) -> tuple[float, ...]:
        """The joints of an arm at home, rad."""
        return tuple(self.home_rad[self.robot.indices(self.robot.names.arm(side))].tolist())

    def encoders(self, q_rad: ArrayLike) -> dict[str, Array]:
        """Readings of each port's encoders at a configuration (n_joints,), degrees; "-" reads 0."""
        value = dict(zip(self.robot.joint_names, np.rad2deg(np.asarray(q_rad, dtype=float)), strict=True))
        if gaze := self.robot.names.gaze_joints:
            left, right = value[gaze[3]], value[gaze[4]]
            value |= {"version": 0.5 * (left + right), "vergence": left - right}
        value["-"] = 0.0
        return {port: np.array([value[name] for name in names]) for port, names in self.ports.items()}

    def configuration(self, encoders: Mapping[str, ArrayLike]) -> Array:
        """(n_joints,) rad of the encoders' readings in degrees; a port that is missing reads 0."""
        value = dict.fromkeys((*self.robot.joint_names, "-"), 0.0)
        for port, reading in encoders.items():
            value.update(zip(self.ports[port], np.asarray(reading, dtype=float), strict=True))
        if "vergence" in value:
            left, right = self.robot.names.gaze_joints[3:]
            value[left] = value["version"] + value["vergence"] / 2
            value[right] = value["version"] - value["vergence"] / 2
        return np.deg2rad([value[name] for name in self.robot.joint_names])
