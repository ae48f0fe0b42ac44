"""Triangle meshes on the graphics side."""

import ctypes
from collections.abc import Iterable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pps_vision.types import Array
from rendering.context import GL
from rendering.shapes import Part

_SHARP = np.deg2rad(50)  # edges sharper than this stay so
_FLOATS = 9  # position, normal, paint


class Mesh:
    """Triangles: positions (m), unit normals and paint (n, 3) each, faces (m, 3).

    Paint is a colour (RGB, 0–1), or the place (u, v, unused) in the atlas if `textured`.  Uploaded
    when first drawn, given back by `free`.  `vertices` (n, 9): position, normal, paint of each.
    """

    def __init__(self, positions: Array, normals: Array, paint: Array, faces: Array, textured: bool = False) -> None:
        self.bounds = np.array([positions.min(axis=0), positions.max(axis=0)])
        self.textured = textured
        self.vertices: NDArray[np.float32] = np.hstack([positions, normals, paint]).astype(np.float32)
        self.faces: NDArray[np.uint32] = np.ascontiguousarray(faces, np.uint32)
        self._array = 0
        self._buffers: list[int] = []

    def draw(self) -> None:
        """Draw with whatever program is in use."""
        if not self._array:
            self._upload()
        GL.glBindVertexArray(self._array)
        GL.glDrawElements(GL.GL_TRIANGLES, self.faces.size, GL.GL_UNSIGNED_INT, None)

    def _upload(self) -> None:
        self._array = GL.glGenVertexArrays(1)
        GL.glBindVertexArray(self._array)
        self._buffers = list(GL.glGenBuffers(2))
        for kind, buffer, data in zip(
            (GL.GL_ARRAY_BUFFER, GL.GL_ELEMENT_ARRAY_BUFFER), self._buffers, (self.vertices, self.faces), strict=True
        ):
            GL.glBindBuffer(kind, buffer)
            GL.glBufferData(kind, data.nbytes, data, GL.GL_STATIC_DRAW)
        for slot in range(3):
            GL.glEnableVertexAttribArray(slot)
            GL.glVertexAttribPointer(slot, 3, GL.GL_FLOAT, False, 4 * _FLOATS, ctypes.c_void_p(12 * slot))

    def free(self) -> None:
        """Give the graphics memory back; drawing again uploads anew."""
        if self._array:
            GL.glDeleteVertexArrays(1, [self._array])
            GL.glDeleteBuffers(2, self._buffers)
            self._array = 0


def mesh_of(parts: Iterable[Part], edge_m: float) -> Mesh:
    """All parts as one mesh, drawn in one go, with no edge longer than `edge_m`: a lens bends what is
    long and straight only at its corners."""
    positions, normals, paint, faces, count = [], [], [], [], 0
    for part in parts:
        shaded = trimesh.graph.smooth_shade(_cut(part.mesh, edge_m), angle=_SHARP)
        positions.append(shaded.vertices)
        normals.append(shaded.vertex_normals)
        paint.append(np.tile(part.color, (len(shaded.vertices), 1)))
        faces.append(shaded.faces + count)
        count += len(shaded.vertices)
    return Mesh(np.vstack(positions), np.vstack(normals), np.vstack(paint), np.vstack(faces))


def _cut(mesh: Any, edge_m: float) -> Any:
    """A mesh whose triangles are halved across their longest edge until none is longer than `edge_m`."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    while True:
        edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=-1)
        long = edges.max(axis=1) > edge_m
        if not long.any():
            return trimesh.Trimesh(vertices, faces)
        first = edges[long].argmax(axis=1)[:, None]
        a, b, c = np.take_along_axis(faces[long], (first + np.arange(3)) % 3, axis=1).T
        middle = len(vertices) + np.arange(len(a))
        vertices = np.vstack([vertices, 0.5 * (vertices[a] + vertices[b])])
        faces = np.vstack([faces[~long], np.column_stack([a, middle, c]), np.column_stack([middle, b, c])])
