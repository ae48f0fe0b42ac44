"""Coloured solids to draw, and the few ways to make them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from pps_vision.robot.model import Body
from pps_vision.types import Array

Color = tuple[float, float, float]  # RGB, 0–1, proportional to light
_SHARP = np.deg2rad(50)  # edges sharper than this stay so


@dataclass(frozen=True)
class Part:
    """A triangle mesh (m, in the frame of the whole) of one colour."""

    mesh: Any
    color: Color


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles as they are drawn: positions (n, 3) m, unit normals (n, 3), faces (m, 3), and colours (n, 3) or
    places in the room's texture (n, 2)."""

    positions: Array
    normals: Array
    faces: NDArray[np.integer[Any]]
    colors: Array
    texture_uv: Array | None = None

    @property
    def bounds(self) -> Array:
        """(2, 3) least and greatest coordinates."""
        return np.array([self.positions.min(axis=0), self.positions.max(axis=0)])


def surface_of(parts: Iterable[Part]) -> Surface:
    """All parts as one surface, drawn in one go, smoothly shaded up to sharp edges."""
    positions, normals, colors, faces, count = [], [], [], [], 0
    for part in parts:
        shaded = trimesh.graph.smooth_shade(part.mesh, angle=_SHARP)
        positions.append(shaded.vertices)
        normals.append(shaded.vertex_normals)
        colors.append(np.tile(part.color, (len(shaded.vertices), 1)))
        faces.append(shaded.faces + count)
        count += len(shaded.vertices)
    return Surface(np.vstack(positions), np.vstack(normals), np.vstack(faces), np.vstack(colors))


def sphere(radius: float, color: Color, center: ArrayLike = (0.0, 0.0, 0.0), fineness: int = 3) -> Part:
    """A ball of 20·4^`fineness` triangles.

    Its surface is the sphere's, so that its silhouette is too, in the mean: a quarter of it, as of any
    convex body.
    """
    mesh = trimesh.creation.icosphere(fineness)
    mesh.apply_scale(radius * np.sqrt(4 * np.pi / mesh.area))
    return Part(mesh.apply_translation(center), color)


def tube(path: ArrayLike, radii: ArrayLike, color: Color, sides: int = 8) -> Part:
    """A bent, tapering tube with round ends: centres (n, 3) and radii (n,), or one radius."""
    p = np.asarray(path, dtype=float)
    r = np.broadcast_to(np.asarray(radii, dtype=float), len(p))
    ahead = np.gradient(p, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    cap = np.deg2rad([80, 55, 30])  # rings of the round ends, from the pole
    front = [(p[0] - r[0] * np.cos(a) * ahead[0], r[0] * np.sin(a), ahead[0]) for a in cap[::-1]]
    back = [(p[-1] + r[-1] * np.cos(a) * ahead[-1], r[-1] * np.sin(a), ahead[-1]) for a in cap]
    rings = [*front, *zip(p, r, ahead, strict=True), *back]

    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    side = np.cross(ahead[0], np.eye(3)[np.argmin(np.abs(ahead[0]))])
    vertices = []
    for center, radius, axis in rings:
        side = side - (side @ axis) * axis  # carried along the path without twisting
        side /= np.linalg.norm(side)
        vertices.append(
            center + radius * (np.outer(np.cos(angles), side) + np.outer(np.sin(angles), np.cross(axis, side)))
        )
    poles = [p[0] - r[0] * ahead[0], p[-1] + r[-1] * ahead[-1]]
    return Part(trimesh.Trimesh(np.vstack([*vertices, *poles]), _tube_faces(len(rings), sides), process=False), color)


def sides_of(fineness: int) -> int:
    """Of a round thing other than a ball."""
    return 4 * max(fineness - 1, 1)


def board(width: float, height: float, color: Color = (0.55, 0.42, 0.28)) -> Part:
    """A sheet of cardboard, 3 mm thick: `width` along x, `height` along y, z its normal."""
    return Part(trimesh.creation.box((width, height, 0.003)), color)


def disc(radius: float, color: Color, thickness: float = 0.001, sides: int = 48) -> Part:
    """A round patch about the origin, z its normal."""
    return Part(trimesh.creation.cylinder(radius, thickness, sections=sides), color)


def _tube_faces(rings: int, sides: int) -> Array:
    """Triangles between neighbouring rings, and from the end rings to the two poles."""
    i = np.arange(sides)
    j = (i + 1) % sides
    low = sides * np.arange(rings - 1)[:, None]
    wall = np.stack([low + i, low + j, low + sides + j, low + i, low + sides + j, low + sides + i], axis=-1)
    last, pole = sides * (rings - 1), sides * rings
    first_cap = np.stack([np.full(sides, pole), j, i], axis=-1)
    last_cap = np.stack([np.full(sides, pole + 1), last + i, last + j], axis=-1)
    return np.vstack([wall.reshape(-1, 3), first_cap, last_cap])


def body_part(body: Body, fineness: int) -> Part:
    """A robot's body in the frame it belongs to; its balls are coarser than the ball that is watched."""
    if body.shape == "sphere":
        mesh = sphere(body.size_m[0], body.color, fineness=max(fineness - 1, 0)).mesh
    elif body.shape == "cylinder":
        mesh = trimesh.creation.cylinder(body.size_m[0], body.size_m[1], sections=2 * sides_of(fineness))
    else:
        mesh = trimesh.creation.box(body.size_m)
    return Part(mesh.apply_transform(body.T_frame_body), body.color)
