"""Intersections of rays with spheres, rectangles and cylinders: exact, without triangles.

Shared by the ray-cast films, the exact images of the rendered room and the tests' scenes; shares nothing with
`rendering`. A solid is a row of numbers. Rays start outside spheres and cylinders.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Mask

BALL_COLUMNS = 4
PANEL_COLUMNS = 12
CYLINDER_COLUMNS = 8
FAST = {"contract", "arcp", "nsz", "reassoc"}
"""Numba's `fastmath` flags of the ray caster: NaN and infinity keep their meaning."""


def ball_row(center: ArrayLike, radius_m: float) -> Array:
    """Return the row (4,) of a sphere."""
    return np.array([*np.asarray(center), radius_m])


def panel_row(center: ArrayLike, right: Array, down: Array) -> Array:
    """Return the row (12,) of a rectangle; `right` and `down` (3,) lead from its centre to the middle of two edges."""
    return np.concatenate([center, right / (right @ right), down / (down @ down), np.cross(right, down)])


def cylinder_row(center: ArrayLike, axis: ArrayLike, radius_m: float, length_m: float) -> Array:
    """Return the row (8,) of a cylinder with flat ends about a unit axis (3,)."""
    return np.array([*np.asarray(center), *np.asarray(axis), radius_m, length_m / 2])


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def difference(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Return a − b of two vectors."""
    return ax - bx, ay - by, az - bz


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def first_hit(ox, oy, oz, dx, dy, dz, balls, panels, cylinders):  # type: ignore[no-untyped-def]
    """Return the distance (in lengths of the direction) and the index of the first solid on a ray; −1 without one.

    Balls (n, 4 or more columns) have the indices from 0 on; panels (m, 12 or more) and cylinders (k, 8 or more) follow.
    """
    nearest = np.inf
    index = -1
    a = dx * dx + dy * dy + dz * dz
    for n in range(balls.shape[0]):
        x, y, z = difference(ox, oy, oz, balls[n, 0], balls[n, 1], balls[n, 2])
        r = balls[n, 3]
        b = x * dx + y * dy + z * dz
        discriminant = b * b - a * (x * x + y * y + z * z - r * r)
        if discriminant > 0:
            t = (-b - np.sqrt(discriminant)) / a
            if 0 < t < nearest:
                nearest = t
                index = n
    for n in range(panels.shape[0]):
        x, y, z = difference(panels[n, 0], panels[n, 1], panels[n, 2], ox, oy, oz)
        t = panels[n, 9] * x + panels[n, 10] * y + panels[n, 11] * z
        t /= panels[n, 9] * dx + panels[n, 10] * dy + panels[n, 11] * dz
        if 0 < t < nearest:
            u, v = panel_coordinates(panels, n, ox + t * dx, oy + t * dy, oz + t * dz)
            if abs(u) <= 1 and abs(v) <= 1:
                nearest = t
                index = balls.shape[0] + n
    for n in range(cylinders.shape[0]):
        t = _cylinder_entry(ox, oy, oz, dx, dy, dz, cylinders[n])
        if 0 < t < nearest:
            nearest = t
            index = balls.shape[0] + panels.shape[0] + n
    return nearest, index


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def panel_coordinates(panels, n, x, y, z):  # type: ignore[no-untyped-def]
    """Return the place of a point within a panel: −1 … 1 to the right and down."""
    x, y, z = difference(x, y, z, panels[n, 0], panels[n, 1], panels[n, 2])
    right = x * panels[n, 3] + y * panels[n, 4] + z * panels[n, 5]
    return right, x * panels[n, 6] + y * panels[n, 7] + z * panels[n, 8]


@njit(cache=True, error_model="numpy")
def _cylinder_entry(ox, oy, oz, dx, dy, dz, row):  # type: ignore[no-untyped-def]
    """Distance to the entry into a cylinder; infinite without one.

    The inside is the intersection of the slab between the ends with the infinite cylinder: it begins at the later of
    both entries and ends at the earlier of both exits.
    """
    x, y, z = difference(ox, oy, oz, row[0], row[1], row[2])
    r = row[6]
    half = row[7]
    along = x * row[3] + y * row[4] + z * row[5]
    rate = dx * row[3] + dy * row[4] + dz * row[5]
    length2 = dx * dx + dy * dy + dz * dz
    a = length2 - rate * rate
    b = x * dx + y * dy + z * dz - along * rate
    c = x * x + y * y + z * z - along * along - r * r
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


@njit(cache=True, error_model="numpy")
def _first_hits(origin, rays, balls, panels, cylinders, distance, index):  # type: ignore[no-untyped-def]
    for k in range(len(rays)):
        d = rays[k]
        distance[k], index[k] = first_hit(origin[0], origin[1], origin[2], d[0], d[1], d[2], balls, panels, cylinders)


def first_hits(
    origin: Array, rays: Array, balls: Array, panels: Array | None = None, cylinders: Array | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Return distance (n,) and index (n,) of the first solid on each of the rays (n, 3), as `first_hit` does."""
    panels = np.empty((0, PANEL_COLUMNS)) if panels is None else panels
    cylinders = np.empty((0, CYLINDER_COLUMNS)) if cylinders is None else cylinders
    distance = np.empty(len(rays))
    index = np.empty(len(rays), np.int64)
    _first_hits(np.asarray(origin, float), np.asarray(rays, float), balls, panels, cylinders, distance, index)
    return distance, index


def cylinder_normals(row: Array, points: Array) -> Array:
    """Return the outward unit normals (n, 3) at points (n, 3) of a cylinder's surface."""
    axis = row[3:6]
    along = (points - row[:3]) @ axis
    across = (points - row[:3]) - along[:, None] * axis
    at_end: Mask = np.abs(along) > row[7] * (1 - 1e-9)
    return np.where(at_end[:, None], np.sign(along)[:, None] * axis, across / row[6])
