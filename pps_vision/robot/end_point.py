"""The point of an arm that is to reach a target: its palm or a taxel."""

from dataclasses import dataclass

import numpy as np

from pps_vision.errors import InputError
from pps_vision.robot.chain import Chain
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import SkinPart, icub_skin
from pps_vision.types import Array


@dataclass(frozen=True)
class EndPoint:
    """A point of the frame that a chain moves."""

    name: str
    """Either "palm" or a taxel such as "left_forearm:27"."""
    chain: Chain
    """The arm."""
    point: Array
    """(3,) in the chain's frame, m."""
    normal: Array
    """(3,) unit normal of the skin there, in the chain's frame."""

    @classmethod
    def of(cls, robot: Robot, side: str, name: str, n_joints: int) -> "EndPoint":
        """The "palm" (the origin of its frame) or a taxel of the arm of `side`, moved by the arm's first `n_joints`.

        InputError for a name of neither.
        """
        joints = robot.names.arm(side)[:n_joints]
        if name == "palm":
            palm = next(part for part in _parts(side) if part.name.endswith("palm"))
            return cls(name, Chain.of(robot, joints, palm.frame), np.zeros(3), palm.normals[0])
        taxels = {f"{part.name}:{i}": (part, k) for part in _parts(side) for k, i in enumerate(part.ids)}
        if name not in taxels:
            raise InputError("end point", f"{name!r} of the {side} arm; expected palm or one of {', '.join(taxels)}")
        part, k = taxels[name]
        return cls(name, Chain.of(robot, joints, part.frame), part.positions_m[k], part.normals[k])

    def positions(self, q_rad: Array) -> tuple[Array, Array]:
        """Positions (N, 3) in the root frame, m, at postures (N, k), and Jacobians (N, 3, k), m/rad."""
        return self.chain.positions(q_rad, self.point)

    def normals(self, q_rad: Array) -> Array:
        """(N, 3) unit normals of the skin in the root frame at postures (N, k)."""
        normals: Array = self.chain.frames(q_rad)[0] @ self.normal
        return normals


def _parts(side: str) -> list[SkinPart]:
    return [part for part in icub_skin().parts if part.name.startswith(side)]
