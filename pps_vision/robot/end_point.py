"""What of an arm is to get somewhere: the palm, or a taxel of its skin."""

from dataclasses import dataclass

import numpy as np

from pps_vision.robot.chain import Chain
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import SkinPart, icub_skin
from pps_vision.types import Array


@dataclass(frozen=True)
class EndPoint:
    """A `point` (3,) m of the frame at a chain's tip, and the unit `normal` (3,) of the skin there."""

    name: str
    chain: Chain
    point: Array
    normal: Array

    @classmethod
    def of(cls, robot: Robot, side: str, name: str, n_joints: int) -> "EndPoint":
        """The "palm" (the origin of its frame) or a taxel, "left_forearm:27", of the arm of `side`, moved by the
        arm's first `n_joints`; ValueError for one that this arm does not carry."""
        joints = robot.names.arm(side)[:n_joints]
        if name == "palm":
            palm = next(part for part in _parts(side) if part.name.endswith("palm"))
            return cls(name, Chain.of(robot, joints, palm.frame), np.zeros(3), palm.normals[0])
        taxels = {f"{part.name}:{i}": (part, k) for part in _parts(side) for k, i in enumerate(part.ids)}
        if name not in taxels:
            raise ValueError(f"end point {name!r} of the {side} arm; expected palm or one of {', '.join(taxels)}")
        part, k = taxels[name]
        return cls(name, Chain.of(robot, joints, part.frame), part.positions_m[k], part.normals[k])

    def positions(self, q_rad: Array) -> tuple[Array, Array]:
        """Where it is, (N, 3) root m, at postures (N, k), and its Jacobian (N, 3, k)."""
        return self.chain.positions(q_rad, self.point)

    def normals(self, q_rad: Array) -> Array:
        """(N, 3) the unit normal of the skin there, root frame."""
        normals: Array = self.chain.frames(q_rad)[0] @ self.normal
        return normals


def _parts(side: str) -> list[SkinPart]:
    return [part for part in icub_skin().parts if part.name.startswith(side)]
