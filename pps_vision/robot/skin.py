"""The artificial skin: virtual taxels, their frames, and touch.

A virtual taxel represents one triangular module (R, "Pressure-sensitive skin").
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.errors import InputError
from pps_vision.robot.chain import Chain
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array, Mask

PartName = Literal["left_forearm", "right_forearm", "left_palm", "right_palm"]
TOUCH_RADIUS_M = 0.020  # a touch this near a virtual taxel's centre is a touch of it

# id: position in mm | unit normal, in the left forearm frame (the right one mirrors y and z)
_FOREARM = {
    27: ((-31, -97, 14), (-0.976, 0.061, 0.208)),
    15: ((-30, -81, 18), (-0.965, 0.091, 0.248)),
    3: ((-30, -70, 5), (-0.987, 0.134, 0.090)),
    183: ((-26, -53, 19), (-0.923, 0.106, 0.371)),
    135: ((-16, -68, 36), (-0.534, 0.118, 0.837)),
    147: ((-24, -85, 30), (-0.823, 0.077, 0.563)),
    159: ((-18, -98, 37), (-0.639, 0.054, 0.768)),
    171: ((-18, -56, 31), (-0.730, 0.176, 0.661)),
    87: ((27, -99, 27), (0.900, -0.009, 0.436)),
    75: ((19, -85, 36), (0.694, 0.074, 0.716)),
    39: ((26, -72, 24), (0.900, 0.086, 0.427)),
    51: ((21, -54, 28), (0.787, 0.166, 0.594)),
}
INNER_FOREARM = (27, 15, 3, 183, 135, 147, 159, 171)
OUTER_FOREARM = (87, 75, 39, 51)
_PALM = {
    "left": {101: (-5.9, 16.2, 0), 99: (-4.9, 1.2, 0), 109: (-19.9, 12.2, 0), 134: (-30.4, 12.2, 0)},
    "right": {101: (-5.9, 16.2, 0), 103: (-4.9, 1.2, 0), 118: (-19.9, 12.2, 0), 137: (-30.4, 12.2, 0)},
}


@dataclass(frozen=True)
class SkinPart:
    """The virtual taxels of one body part."""

    name: str  # such as "left_forearm"
    frame: str  # the robot's frame that carries it
    ids: tuple[int, ...]  # n numbers of taxels
    positions_m: Array  # (n, 3) in `frame`
    normals: Array  # (n, 3) unit normals in `frame`
    margin: float = 1.0
    """Factor of the safety margin (R: more about the face and the hands): objects count as this much nearer."""

    def __post_init__(self) -> None:
        if not 0 < self.margin < np.inf:
            raise ValueError(f"skin part {self.name}: margin {self.margin}, expected a factor above 0")
        if self.positions_m.shape != (len(self.ids), 3) or self.normals.shape != (len(self.ids), 3):
            raise ValueError(f"skin part {self.name}: {len(self.ids)} ids, expected as many positions and normals")
        lengths = np.linalg.norm(self.normals, axis=1)
        if not np.allclose(lengths, 1, atol=1e-6):
            raise ValueError(f"skin part {self.name}: normals of length {lengths.min():.3f}–{lengths.max():.3f}, not 1")


@dataclass(frozen=True)
class Skin:
    """All body parts; arrays of taxels are in the order of `parts`."""

    parts: tuple[SkinPart, ...]  # the body parts

    @cached_property
    def taxel_ids(self) -> tuple[str, ...]:
        """Names "part:id" of all taxels."""
        return tuple(f"{part.name}:{i}" for part in self.parts for i in part.ids)

    @cached_property
    def part_index(self) -> NDArray[np.intp]:
        """(n,) number of each taxel's part."""
        return np.repeat(np.arange(len(self.parts)), [len(part.ids) for part in self.parts])

    @cached_property
    def margins(self) -> Array:
        """(n,) factor of each taxel's safety margin."""
        return np.repeat([part.margin for part in self.parts], [len(part.ids) for part in self.parts])

    def index(self, taxel_id: str) -> int:
        """Position of a taxel "part:id"; InputError for an unknown one."""
        if taxel_id not in self.taxel_ids:
            raise InputError("skin", f"no taxel {taxel_id!r}; this skin has {', '.join(self.taxel_ids)}")
        return self.taxel_ids.index(taxel_id)

    def taxel(self, index: int) -> tuple[str, Array]:
        """The frame that carries a taxel, and its position (3,) m in that frame."""
        part = self.parts[self.part_index[index]]
        first = int(np.searchsorted(self.part_index, self.part_index[index]))
        return part.frame, part.positions_m[index - first]

    def on_arm(self, robot: Robot, side: str) -> "Skin":
        """The body parts that joints of the "left" or "right" arm move."""
        joints = set(robot.names.arm(side))
        return Skin(tuple(part for part in self.parts if not joints.isdisjoint(robot.moving(part.frame))))

    def at(self, posture: Posture) -> tuple[Array, Array]:
        """Positions (n, 3) m and unit normals (n, 3) of all taxels in the root frame.

        Normals turn with the body; they are directions and are not translated.
        """
        poses = [(part, posture.T_root(part.frame)) for part in self.parts]
        positions = [part.positions_m @ T[:3, :3].T + T[:3, 3] for part, T in poses]
        return np.concatenate(positions), np.concatenate([part.normals @ T[:3, :3].T for part, T in poses])

    def jacobians(self, posture: Posture, joints: list[int]) -> Array:
        """Velocities (n, 3, k) m/rad of all taxels in the root frame for the rates of k joints."""
        jacobians = []
        for part in self.parts:
            J = posture.jacobian(part.frame)[:, joints]
            levers = part.positions_m @ posture.T_root(part.frame)[:3, :3].T
            jacobians.append(J[:3].T + np.cross(J[3:].T[None], levers[:, None]))
        return np.concatenate(jacobians).transpose(0, 2, 1)


def icub_skin(parts: tuple[PartName, ...] = ("left_forearm", "right_forearm", "left_palm", "right_palm")) -> Skin:
    """The virtual taxels of R, one per triangular module."""
    return Skin(tuple(_icub_part(name) for name in parts))


def _icub_part(name: str) -> SkinPart:
    side, part = name.split("_")
    sign = 1.0 if side == "left" else -1.0
    if part == "forearm":
        ids = tuple(_FOREARM)
        mirror = np.array([1, sign, sign])
        positions = np.array([_FOREARM[i][0] for i in ids], dtype=float) * mirror
        normals = np.array([_FOREARM[i][1] for i in ids]) * mirror
    else:
        ids = tuple(_PALM[side])
        positions = np.array([_PALM[side][i] for i in ids], dtype=float)
        normals = np.tile([0.0, 0.0, -sign], (len(ids), 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return SkinPart(name, name, ids, positions / 1000, normals)


def taxel_frame(position: ArrayLike, normal: ArrayLike) -> Array:
    """`T_part_taxel`: z along the outward normal, y ∝ (−nz/nx, 0, 1), x = −(z × y) (R)."""
    z = np.asarray(normal, dtype=float)
    z = z / np.linalg.norm(z)
    nx = z[0] if z[0] != 0 else 1e-8
    y = np.array([-z[2] / nx, 0.0, 1.0])
    y /= np.linalg.norm(y)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([-np.cross(z, y), y, z])
    T[:3, 3] = position
    return T


def touched_taxels(positions_root: Array, center_root: ArrayLike, radius_m: float) -> Mask:
    """(n,) taxels that a ball of `radius_m` about `center_root` touches: its surface is within 20 mm of the taxel's
    centre (R)."""
    gap = np.linalg.norm(positions_root - np.asarray(center_root, dtype=float), axis=1) - radius_m
    return np.asarray(gap <= TOUCH_RADIUS_M)


@dataclass(frozen=True)
class EndPoint:
    """The point of an arm that is to reach a target: its palm or a taxel, in the frame that a chain moves."""

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
