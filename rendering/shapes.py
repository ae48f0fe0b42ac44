"""Coloured triangle meshes and how they are made."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from pps_vision.robot.model import Body
from pps_vision.types import Array

Color = tuple[float, float, float]  # RGB, 0–1, proportional to light
_SHARP = np.deg2rad(50)  # edges sharper than this are not smoothed


@dataclass(frozen=True)
class Part:
    """A triangle mesh of one colour; m, in the object's frame."""

    mesh: Any
    color: Color


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles as drawn: positions (n, 3) m, unit normals (n, 3), faces (m, 3), colours (n, 3), and for the room
    texture coordinates (n, 2)."""

    positions: Array
    normals: Array
    faces: NDArray[np.integer[Any]]
    colors: Array
    texture_uv: Array | None = None

    @property
    def bounds(self) -> Array:
        """Smallest and largest coordinates, (2, 3) m."""
        return np.array([self.positions.min(axis=0), self.positions.max(axis=0)])


def surface_of(parts: Iterable[Part]) -> Surface:
    """Return all parts as one surface with smoothed normals."""
    parts = list(parts)
    meshes = [trimesh.graph.smooth_shade(part.mesh, angle=_SHARP) for part in parts]
    sizes = [len(mesh.vertices) for mesh in meshes]
    faces = [mesh.faces + first for mesh, first in zip(meshes, np.cumsum([0, *sizes[:-1]]), strict=True)]
    colors = np.repeat([part.color for part in parts], sizes, axis=0)
    positions, normals = (np.vstack([getattr(mesh, key) for mesh in meshes]) for key in ("vertices", "vertex_normals"))
    return Surface(positions, normals, np.vstack(faces), colors)


def sphere(radius: float, color: Color, center: ArrayLike = (0.0, 0.0, 0.0), fineness: int = 3) -> Part:
    """Return a ball of 20·4^`fineness` triangles with the sphere's surface area.

    Its mean silhouette then equals the sphere's: a quarter of the surface, as for every convex body (Cauchy).
    """
    mesh = trimesh.creation.icosphere(fineness)
    mesh.apply_scale(radius * np.sqrt(4 * np.pi / mesh.area))
    return Part(mesh.apply_translation(center), color)


def tube(path: ArrayLike, radii: ArrayLike, color: Color, sides: int) -> Part:
    """Return a curved, tapered tube with round ends; `path` (n, 3), `radii` (n,) or one radius."""
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
        circle = np.outer(np.cos(angles), side) + np.outer(np.sin(angles), np.cross(axis, side))
        vertices.append(center + radius * circle)
    poles = [p[0] - r[0] * ahead[0], p[-1] + r[-1] * ahead[-1]]
    return Part(trimesh.Trimesh(np.vstack([*vertices, *poles]), _tube_faces(len(rings), sides), process=False), color)


def sides_of(fineness: int) -> int:
    """Return the number of sides of a tube or cylinder."""
    return 4 * max(fineness - 1, 1)


def board(width: float, height: float, color: Color = (0.55, 0.42, 0.28)) -> Part:
    """Return a 3 mm board: `width` along x, `height` along y, normal z."""
    return Part(trimesh.creation.box((width, height, 0.003)), color)


def _tube_faces(rings: int, sides: int) -> Array:
    """Return the triangles between neighbouring rings and between the end rings and the poles."""
    i = np.arange(sides)
    j = (i + 1) % sides
    low = sides * np.arange(rings - 1)[:, None]
    wall = np.stack([low + i, low + j, low + sides + j, low + i, low + sides + j, low + sides + i], axis=-1)
    last = sides * (rings - 1)
    pole = sides * rings
    first_cap = np.column_stack([np.full(sides, pole), j, i])
    last_cap = np.column_stack([np.full(sides, pole + 1), last + i, last + j])
    return np.vstack([wall.reshape(-1, 3), first_cap, last_cap])


def body_part(body: Body, fineness: int) -> Part:
    """Return a robot's body in its frame; spheres are one level coarser than the stimulus."""
    if body.shape == "sphere":
        mesh = sphere(body.size_m[0], body.color, fineness=max(fineness - 1, 0)).mesh
    elif body.shape == "cylinder":
        mesh = trimesh.creation.cylinder(body.size_m[0], body.size_m[1], sections=2 * sides_of(fineness))
    else:
        mesh = trimesh.creation.box(body.size_m)
    return Part(mesh.apply_transform(body.T_frame_body), body.color)
