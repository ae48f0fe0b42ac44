"""Cones of directions through rim points, compiled by numba as in `compiled`: some hundred points, three unknowns."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pps_vision.geometry.compiled import Vector
from pps_vision.types import Array
from tracking.kernels import Map

_NOWHERE = (math.nan, math.nan, math.nan)


@njit(cache=True, error_model="numpy")
def crossings(alpha: Map, bearings: Array, left: int, top: int) -> Array:
    """(n, 3) unit directions where the coverage (h, w) of a region, whose corner is there, crosses ½ between
    neighbouring pixels; `bearings` (height, width, 3) are those of the image's."""
    height, width = alpha.shape
    found, n = np.empty((2 * height * width, 3)), 0
    for y in range(height):
        for x in range(width):
            for v, u in ((y, x + 1), (y + 1, x)):
                if v == height or u == width or (alpha[y, x] > 0.5) == (alpha[v, u] > 0.5):
                    continue
                level = float(alpha[y, x])
                t, norm = (0.5 - level) / (float(alpha[v, u]) - level), 0.0
                for k in range(3):
                    p = bearings[top + y, left + x, k]
                    found[n, k] = p + t * (bearings[top + v, left + u, k] - p)
                    norm += found[n, k] ** 2
                found[n] /= math.sqrt(norm)
                n += 1
    return found[:n].copy()


@njit(cache=True, error_model="numpy")
def off_cone(ray: Array, axis: Vector, scale: float) -> float:
    """How far a direction (3,) is from the cone b·axis = 1, times a scale."""
    return (ray[0] * axis[0] + ray[1] * axis[1] + ray[2] * axis[2] - 1) * scale


@njit(cache=True, error_model="numpy")
def scale_of(axis: Vector, focal_px: float) -> float:
    """What makes an angle in pixels of b·axis − 1 near the cone."""
    length2 = axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2
    return focal_px / math.sqrt(max(length2, 1 + 1e-9) - 1)


@njit(cache=True, error_model="numpy")
def consensus(rays: Array, focal_px: float, within_px: float) -> tuple[Vector, int]:
    """The cone through three rays (n, 3) an arc apart that most of the others agree with, and how many do; 0 where no
    three make a cone."""
    order, n, best, most = _around(rays), len(rays), _NOWHERE, 0
    for start in range(0, n, max(n // 24, 1)):
        for arc in (n // 5, n // 8):
            a, b, c = rays[order[start]], rays[order[(start + arc) % n]], rays[order[(start + 2 * arc) % n]]
            bc, ca, ab = _cross(b, c), _cross(c, a), _cross(a, b)
            det = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2]
            if abs(det) <= 1e-12:
                continue
            axis = (bc[0] + ca[0] + ab[0]) / det, (bc[1] + ca[1] + ab[1]) / det, (bc[2] + ca[2] + ab[2]) / det
            scale, agreeing = scale_of(axis, focal_px), 0
            for k in range(n):
                agreeing += abs(off_cone(rays[k], axis, scale)) < within_px
            if agreeing > most:
                best, most = axis, agreeing
    return best, most


@njit(cache=True, error_model="numpy")
def _around(rays: Array) -> NDArray[np.int64]:
    """(n,) the rays' order around their middle."""
    x = y = z = 0.0
    for k in range(len(rays)):
        x, y, z = x + rays[k, 0], y + rays[k, 1], z + rays[k, 2]
    middle = np.array((x, y, z))
    up = np.array((0.0, 1.0, 0.0)) if abs(y) < max(abs(x), abs(z)) else np.array((1.0, 0.0, 0.0))
    (a, b, c), angle = _cross(up, middle), np.empty(len(rays))
    d, e, f = _cross(middle, np.array((a, b, c)))
    length = math.sqrt((d * d + e * e + f * f) / (a * a + b * b + c * c))
    for k in range(len(rays)):
        p, q, r = rays[k]
        angle[k] = math.atan2((d * p + e * q + f * r) / length, a * p + b * q + c * r)
    return np.argsort(angle)


@njit(cache=True, error_model="numpy")
def _cross(a: Array, b: Array) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def fitted(rays: Array, axis: Vector, fair_px: float, focal_px: float, rounds: int) -> Vector:
    """The cone nearest to the rays (n, 3), of which those farther than `fair_px` off count less, starting from one of
    about this `axis`, or counting all alike from NaN; NaN where they do not tell."""
    for _ in range(rounds):
        xx = xy = xz = yy = yz = zz = sx = sy = sz = 0.0
        scale = scale_of(axis, focal_px)
        for k in range(len(rays)):
            off = abs(off_cone(rays[k], axis, scale))
            w = 1.0 if math.isnan(off) else 1 / max(off, fair_px) ** 2
            x, y, z = rays[k]
            sx, sy, sz = sx + w * x, sy + w * y, sz + w * z
            xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
            yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
        # Cramer's rule: the adjugate of the normal matrix, row by row
        a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        det = xx * a + xy * b + xz * c
        size = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)
        size *= a * a + d * d + f * f + 2 * (b * b + c * c + e * e)
        if not det * det * 1e20 > size:  # the condition number, squared
            return _NOWHERE
        axis = (a * sx + b * sy + c * sz) / det, (b * sx + d * sy + e * sz) / det, (c * sx + e * sy + f * sz) / det
    ahead = axis[0] * rays[0, 0] + axis[1] * rays[0, 1] + axis[2] * rays[0, 2]
    return axis if ahead > 0 else _NOWHERE


@njit(cache=True, error_model="numpy")
def on_sides(points: NDArray[np.float32], corners: NDArray[np.float32], within: float) -> NDArray[np.bool_]:
    """(n,) which points (n, 2) are that near to the line through two neighbouring corners (m, 2)."""
    on = np.zeros(len(points), np.bool_)
    for i in range(len(corners)):
        x, y = float(corners[i, 0]), float(corners[i, 1])
        dx, dy = float(corners[(i + 1) % len(corners), 0]) - x, float(corners[(i + 1) % len(corners), 1]) - y
        length = math.sqrt(dx * dx + dy * dy)
        if length > 0:
            for k in range(len(points)):
                on[k] |= abs((points[k, 0] - x) * dy - (points[k, 1] - y) * dx) < within * length
    return on
