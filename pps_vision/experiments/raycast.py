"""What a ray meets first: spheres, flat panels and cylinders, exactly and without triangles.

The one intersection code of the independent scenes, of the exact images of the rendered room and of the tests' scenes.
It shares nothing with `rendering`. Each solid is a row of numbers; rays start outside of spheres and cylinders.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Mask

BALL_COLUMNS, PANEL_COLUMNS, CYLINDER_COLUMNS = 4, 12, 8
FAST = {"contract", "arcp", "nsz", "reassoc"}
"""Numba's `fastmath` of the ray casters: no assumption about NaN and infinity."""


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
def first_hit(ox, oy, oz, dx, dy, dz, balls, panels, cylinders):  # type: ignore[no-untyped-def]
    """Distance (in lengths of the direction) and index of what a ray meets first; −1: nothing.

    Balls (n, 4 or more columns) have the indices from 0 on, panels (m, 12 or more) follow them, then cylinders (k, 8).
    """
    best, which = np.inf, -1
    a = dx * dx + dy * dy + dz * dz
    for n in range(balls.shape[0]):
        x, y, z, r = ox - balls[n, 0], oy - balls[n, 1], oz - balls[n, 2], balls[n, 3]
        b = x * dx + y * dy + z * dz
        under = b * b - a * (x * x + y * y + z * z - r * r)
        if under > 0:
            t = (-b - np.sqrt(under)) / a
            if 0 < t < best:
                best, which = t, n
    for n in range(panels.shape[0]):
        nx, ny, nz = panels[n, 9], panels[n, 10], panels[n, 11]
        t = nx * (panels[n, 0] - ox) + ny * (panels[n, 1] - oy) + nz * (panels[n, 2] - oz)
        t /= nx * dx + ny * dy + nz * dz
        if 0 < t < best:
            u, v = on_panel(panels, n, ox + t * dx, oy + t * dy, oz + t * dz)
            if abs(u) <= 1 and abs(v) <= 1:
                best, which = t, balls.shape[0] + n
    for n in range(cylinders.shape[0]):
        t = _cylinder_entry(ox, oy, oz, dx, dy, dz, cylinders[n])
        if 0 < t < best:
            best, which = t, balls.shape[0] + panels.shape[0] + n
    return best, which


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def on_panel(panels, n, x, y, z):  # type: ignore[no-untyped-def]
    """Where a point of a panel's plane is on it: −1 … 1 to the right and down."""
    x, y, z = x - panels[n, 0], y - panels[n, 1], z - panels[n, 2]
    right = x * panels[n, 3] + y * panels[n, 4] + z * panels[n, 5]
    return right, x * panels[n, 6] + y * panels[n, 7] + z * panels[n, 8]


@njit(cache=True, error_model="numpy")
def _cylinder_entry(ox, oy, oz, dx, dy, dz, row):  # type: ignore[no-untyped-def]
    """Distance to the entry; infinite without one. Inside is between the last entry into and the first exit out of
    the slab between the ends and the endless cylinder."""
    x, y, z, r, half = ox - row[0], oy - row[1], oz - row[2], row[6], row[7]
    along, rate = x * row[3] + y * row[4] + z * row[5], dx * row[3] + dy * row[4] + dz * row[5]
    length2 = dx * dx + dy * dy + dz * dz
    a = length2 - rate * rate
    b = x * dx + y * dy + z * dz - along * rate
    c = x * x + y * y + z * z - along * along - r * r
    one, other = (-half - along) / rate, (half - along) / rate
    entry, leave = min(one, other), max(one, other)
    if a > 1e-15 * length2:
        under = b * b - a * c
        if under <= 0:
            return np.inf
        entry, leave = max(entry, (-b - np.sqrt(under)) / a), min(leave, (-b + np.sqrt(under)) / a)
    elif c > 0:  # along the axis, beside the cylinder
        return np.inf
    return entry if entry < leave else np.inf


@njit(cache=True, error_model="numpy")
def _first_hits(origin, rays, balls, panels, cylinders, distance, which):  # type: ignore[no-untyped-def]
    for k in range(len(rays)):
        d = rays[k]
        distance[k], which[k] = first_hit(origin[0], origin[1], origin[2], d[0], d[1], d[2], balls, panels, cylinders)


def first_hits(
    origin: Array, rays: Array, balls: Array, panels: Array | None = None, cylinders: Array | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Return the distance (in lengths of the ray) and the index of what each of the rays (n, 3) meets first, as
    `first_hit` counts them; infinite and −1 where there is nothing."""
    panels = np.empty((0, PANEL_COLUMNS)) if panels is None else panels
    cylinders = np.empty((0, CYLINDER_COLUMNS)) if cylinders is None else cylinders
    distance, which = np.empty(len(rays)), np.empty(len(rays), np.int64)
    _first_hits(np.asarray(origin, float), np.asarray(rays, float), balls, panels, cylinders, distance, which)
    return distance, which


def cylinder_normals(row: Array, points: Array) -> Array:
    """Return the outward unit normals (n, 3) at points (n, 3) of a cylinder's surface."""
    axis, radius_m, half = row[3:6], row[6], row[7]
    along = (points - row[:3]) @ axis
    across = (points - row[:3]) - along[:, None] * axis
    at_end: Mask = np.abs(along) > half * (1 - 1e-9)
    return np.where(at_end[:, None], np.sign(along)[:, None] * axis, across / radius_m)
