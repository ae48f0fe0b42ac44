"""A stimulus from a mesh file."""

from io import BytesIO
from pathlib import Path
from typing import Any, get_args

import numpy as np
import trimesh
from scipy.spatial import QhullError

from pps_vision.errors import InputError
from pps_vision.files import read_bytes
from rendering.names import MESH_SUFFIXES, Unit
from rendering.shapes import Color, Part
from rendering.stimuli import ORANGE, Stimulus

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_SMALLEST_M, _LARGEST_M = 0.002, 0.6  # extent of an object that fits the eyes' view at 0.3 m
_MOST_TRIANGLES = 200_000


def load_stimulus(file: Path, unit: Unit = "m", radius_m: float | None = None) -> Stimulus:
    """The mesh of an STL, OBJ or PLY file as a stimulus of one colour, the file's mean colour or orange.

    Its centre, the origin of the stimulus, is the centroid of its convex hull's volume; its radius that of the sphere
    whose silhouette is, over all directions, as large as the hull's: √(hull surface / 4π), by Cauchy's theorem.

    It is scaled to `radius_m`, if given.  InputError if the file cannot be read, or holds no mesh, numbers that are not
    finite, no volume, or an object of implausible size.
    """
    if file.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(file, f"expected a mesh file ({', '.join(MESH_SUFFIXES)})")
    mesh = _read(file)
    if not len(mesh.faces):
        raise InputError(file, "holds no triangles; expected a mesh")
    if mesh.vertices.shape[1:] != (3,) or not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise InputError(file, "has triangles without vertices in space; expected three coordinates of each corner")
    if len(mesh.faces) > _MOST_TRIANGLES:
        raise InputError(file, f"{len(mesh.faces)} triangles; expected at most {_MOST_TRIANGLES}")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(file, "holds vertices that are not finite; expected numbers")
    mesh.apply_scale(_METRES[unit])
    size_m = float(mesh.extents.max())
    if radius_m is None and not _SMALLEST_M <= size_m <= _LARGEST_M:
        expected = f"{_SMALLEST_M} to {_LARGEST_M} m (units: {', '.join(get_args(Unit))})"
        raise InputError(file, f"{size_m:.3g} m across if its unit is {unit}; expected {expected}")
    try:
        hull = mesh.convex_hull
    except QhullError as error:
        raise InputError(file, "its vertices lie in a plane; expected a solid") from error
    radius = float(np.sqrt(hull.area / (4 * np.pi)))
    mesh.apply_translation(-hull.center_mass)
    if radius_m is not None:
        mesh.apply_scale(radius_m / radius)
    color = _color(mesh)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)  # a file may list each triangle's own
    with np.errstate(invalid="ignore", divide="ignore"):  # by a volume of 0, where triangles cancel
        mesh.fix_normals()
    parts = [Part(mesh, color)]
    if not mesh.is_watertight:  # its inside can be visible
        inside = mesh.copy()
        inside.invert()
        parts.append(Part(inside, color))
    return Stimulus(file.stem, radius if radius_m is None else radius_m, tuple(parts))


class _Materials(trimesh.resolvers.Resolver):
    """Finds a mesh's file of materials; textures, which nobody sees here, are not read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, name: str) -> bytes:
        """Return the content of a .mtl file."""
        if Path(name).suffix.lower() != ".mtl":
            raise ValueError(f"{name} is no .mtl")
        return read_bytes(self.folder / name, "materials")

    def write(self, name: str, data: bytes) -> None:
        """Not needed to read."""
        raise NotImplementedError

    def namespaced(self, namespace: str) -> "_Materials":
        """Return the same for a folder below."""
        return _Materials(self.folder / namespace)

    def keys(self) -> list[str]:
        """Return no names; they are asked for."""
        return []


def _read(file: Path) -> Any:
    """Return the file's meshes as one.  Whatever trimesh's parsers raise on a malformed file is an InputError."""
    content = read_bytes(file, "a mesh")
    if not content:
        raise InputError(file, "is empty; expected a mesh")
    kind = file.suffix[1:].lower()
    try:
        return trimesh.load_mesh(BytesIO(content), file_type=kind, process=False, resolver=_Materials(file.parent))
    except InputError:
        raise
    except Exception as error:  # each parser raises its own kinds (KeyError, struct.error, AssertionError, …)
        raise InputError(file, f"cannot be read as {kind.upper()}; expected a mesh") from error


def _color(mesh: Any) -> Color:
    """The mean colour of a file that has colours."""
    if not mesh.visual.defined:
        return ORANGE
    is_painted = mesh.visual.kind == "texture"
    colors = [mesh.visual.material.main_color] if is_painted else mesh.visual.vertex_colors
    red, green, blue = np.asarray(colors)[:, :3].mean(axis=0) / 255
    return float(red), float(green), float(blue)
