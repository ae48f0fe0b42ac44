"""The point of an arm that is to reach a target: its palm or a taxel."""

from dataclasses import dataclass

import numpy as np

from pps_vision.errors import InputError
from pps_vision.robot.chain import Chain
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array


@dataclass(frozen=True)
class EndPoint:
    """A point of the frame that a chain moves."""

    name: str  # either "palm" or a taxel such as "left_forearm:27"
    chain: Chain  # the arm
    point: Array  # (3,) in the chain's frame, m
    normal: Array  # (3,) unit normal of the skin there, in the chain's frame

    @classmethod
    def of(cls, robot: Robot, side: str, name: str, n_joints: int, skin: Skin | None = None) -> "EndPoint":
        """The "palm" (the origin of its frame) or a taxel of the arm of `side`, moved by the arm's first `n_joints`.

        Of the iCub's skin by default.  A palm without taxels faces along z.  InputError for a name of neither.
        """
        joints = robot.names.arm(side)[:n_joints]
        parts = (skin or icub_skin()).on_arm(robot, side).parts
        if name == "palm":
            palm = robot.names.palm(side)
            normal = next((part.normals[0] for part in parts if part.frame == palm), np.array([0.0, 0.0, 1.0]))
            return cls(name, robot.chain(joints, palm), np.zeros(3), normal)
        taxels = {f"{part.name}:{i}": (part, k) for part in parts for k, i in enumerate(part.ids)}
        if name not in taxels:
            raise InputError("end point", f"{name!r} of the {side} arm; expected palm or one of {', '.join(taxels)}")
        part, k = taxels[name]
        return cls(name, robot.chain(joints, part.frame), part.positions_m[k], part.normals[k])

    def positions(self, q_rad: Array) -> tuple[Array, Array]:
        """Positions (N, 3) in the root frame, m, at postures (N, k), and Jacobians (N, 3, k), m/rad."""
        return self.chain.positions(q_rad, self.point)

    def normals(self, q_rad: Array) -> Array:
        """(N, 3) unit normals of the skin in the root frame at postures (N, k)."""
        return np.asarray(self.chain.frames(q_rad)[0] @ self.normal)
