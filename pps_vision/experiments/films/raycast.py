"""Intersections of rays with spheres, rectangles and cylinders: exact, without triangles.

Shared by the ray-cast films, the exact images of the rendered room and the tests' scenes; shares nothing with
`rendering`. A solid is a row (13,) of numbers: kind, centre and shape. Rays start outside spheres and cylinders.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array

BALL = 0.0
PANEL = 1.0
CYLINDER = 2.0
COLUMNS = 13  # numbers of a solid
FAST = {"contract", "arcp", "nsz", "reassoc"}
"""Numba's `fastmath` flags of the ray caster: NaN and infinity keep their meaning."""


def ball_row(center: ArrayLike, radius_m: float) -> Array:
    """Return the row of a sphere."""
    return _row(BALL, center, [radius_m])


def panel_row(center: ArrayLike, right: Array, down: Array) -> Array:
    """Return the row of a rectangle; `right` and `down` (3,) lead from its centre to the middle of two edges."""
    return _row(PANEL, center, [*right / (right @ right), *down / (down @ down), *np.cross(right, down)])


def cylinder_row(center: ArrayLike, axis: ArrayLike, radius_m: float, length_m: float) -> Array:
    """Return the row of a cylinder with flat ends about a unit axis (3,)."""
    return _row(CYLINDER, center, [*np.asarray(axis), radius_m, length_m / 2])


def _row(kind: float, center: ArrayLike, shape: list[float]) -> Array:
    return np.array([kind, *np.asarray(center), *shape, *[0.0] * (COLUMNS - 4 - len(shape))])


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def dot(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Return the scalar product of two vectors."""
    return ax * bx + ay * by + az * bz


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def first_hit(ox, oy, oz, dx, dy, dz, solids, near):  # type: ignore[no-untyped-def]
    """Return the distance (in lengths of the direction) and the index of the first solid on a ray; −1 without one.

    Solids (n, 13 or more columns) may be of any kinds; only those whose indices are in `near` are looked at.
    """
    nearest = np.inf
    index = -1
    a = dot(dx, dy, dz, dx, dy, dz)
    for n in near:
        x = ox - solids[n, 1]
        y = oy - solids[n, 2]
        z = oz - solids[n, 3]
        t = np.inf
        if solids[n, 0] == BALL:
            b = dot(x, y, z, dx, dy, dz)
            discriminant = b * b - a * (dot(x, y, z, x, y, z) - solids[n, 4] * solids[n, 4])
            if discriminant > 0:
                t = (-b - np.sqrt(discriminant)) / a
        elif solids[n, 0] == PANEL:
            t = -dot(solids[n, 10], solids[n, 11], solids[n, 12], x, y, z)
            t /= dot(solids[n, 10], solids[n, 11], solids[n, 12], dx, dy, dz)
            if 0 < t < nearest:
                u, v = panel_coordinates(solids[n], x + t * dx, y + t * dy, z + t * dz)
                if abs(u) > 1 or abs(v) > 1:
                    t = np.inf
        else:
            t = _cylinder_entry(x, y, z, dx, dy, dz, solids[n])
        if 0 < t < nearest:
            nearest = t
            index = n
    return nearest, index


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def panel_coordinates(row, x, y, z):  # type: ignore[no-untyped-def]
    """Return the coordinates −1 … 1, to the right and down, of a point of a panel given from its centre."""
    return dot(x, y, z, row[4], row[5], row[6]), dot(x, y, z, row[7], row[8], row[9])


@njit(cache=True, error_model="numpy")
def _cylinder_entry(x, y, z, dx, dy, dz, row):  # type: ignore[no-untyped-def]
    """Distance to the entry into a cylinder of a ray from a point given from its centre; infinite without one.

    The inside is the intersection of the slab between the ends with the infinite cylinder: it begins at the later of
    both entries and ends at the earlier of both exits.
    """
    r = row[7]
    half = row[8]
    along = dot(x, y, z, row[4], row[5], row[6])
    rate = dot(dx, dy, dz, row[4], row[5], row[6])
    length2 = dot(dx, dy, dz, dx, dy, dz)
    a = length2 - rate * rate
    b = dot(x, y, z, dx, dy, dz) - along * rate
    c = dot(x, y, z, x, y, z) - along * along - r * r
    lower_end = (-half - along) / rate
    upper_end = (half - along) / rate
    entry = min(lower_end, upper_end)
    leave = max(lower_end, upper_end)
    if a > 1e-15 * length2:
        discriminant = b * b - a * c
        if discriminant <= 0:
            return np.inf
        entry = max(entry, (-b - np.sqrt(discriminant)) / a)
        leave = min(leave, (-b + np.sqrt(discriminant)) / a)
    elif c > 0:  # along the axis, beside the cylinder
        return np.inf
    return entry if entry < leave else np.inf


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def unit_normal(row, x, y, z):  # type: ignore[no-untyped-def]
    """Return the normal at a point of a surface given from the solid's centre: outward, or a panel's right × down."""
    if row[0] == PANEL:
        x = row[10]
        y = row[11]
        z = row[12]
    elif row[0] == CYLINDER:
        along = dot(x, y, z, row[4], row[5], row[6])
        at_end = abs(along) > row[8] * (1 - 1e-9)
        x = along * row[4] if at_end else x - along * row[4]
        y = along * row[5] if at_end else y - along * row[5]
        z = along * row[6] if at_end else z - along * row[6]
    length = np.sqrt(dot(x, y, z, x, y, z))
    return x / length, y / length, z / length


@njit(cache=True, error_model="numpy")
def _first_hits(origin, rays, solids, distance, index, normals):  # type: ignore[no-untyped-def]
    whole = np.arange(len(solids))
    for k in range(len(rays)):
        d = rays[k]
        t, n = first_hit(origin[0], origin[1], origin[2], d[0], d[1], d[2], solids, whole)
        distance[k] = t
        index[k] = n
        if n >= 0:
            p = origin + t * d - solids[n, 1:4]
            normals[k, 0], normals[k, 1], normals[k, 2] = unit_normal(solids[n], p[0], p[1], p[2])


def first_hits(origin: Array, rays: Array, solids: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """Return distance (n,), index (n,) and unit normal (n, 3) of the first solid on each of the rays (n, 3).

    Distances and indices are as in `first_hit`; without a hit the normal is 0.
    """
    distance = np.empty(len(rays))
    index = np.empty(len(rays), np.int64)
    normals = np.zeros((len(rays), 3))
    _first_hits(np.asarray(origin, float), np.asarray(rays, float), solids, distance, index, normals)
    return distance, index, normals
