"""Where two eyes' image points meet, and how well that is known."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.camera import StereoView, Vector, View
from pps_vision.types import Array

_ROUNDS = 20  # two are usual; a strong lens takes more, for it is undone along the way
_SETTLED = 1e-5  # rad: a round that moves the rays so far leaves about 1e-11, for what is left goes by the square
_PARALLEL = 1e-10  # squared sine of the angle between rays that do not meet


@dataclass(frozen=True, slots=True)
class Triangulation:
    """`p_root` (3,) m, `cov_root` (3, 3) m² (the Cramér–Rao bound for the given pixel noise),
    `residual_px` the RMS reprojection error over the four image coordinates, and
    `mahalanobis` its size in units of the pixel noise (χ² with one degree of freedom)."""

    p_root: Array
    cov_root: Array
    residual_px: float
    mahalanobis: float


def midpoint(center_a: Array, ray_a: Array, center_b: Array, ray_b: Array) -> Array | None:
    """Middle of the shortest segment between two rays (3,), or None if it lies behind a centre
    or the rays are parallel."""
    gap = center_b - center_a
    cosine = float(ray_a @ ray_b)
    denominator = 1 - cosine**2
    if denominator < _PARALLEL:
        return None
    along_a = (gap @ ray_a - cosine * (gap @ ray_b)) / denominator
    along_b = (cosine * (gap @ ray_a) - gap @ ray_b) / denominator
    if along_a <= 0 or along_b <= 0:
        return None
    middle: Array = 0.5 * (center_a + along_a * ray_a + center_b + along_b * ray_b)
    return middle


def triangulate(
    view: StereoView,
    left_px: ArrayLike,
    right_px: ArrayLike,
    cov_left_px: ArrayLike,
    cov_right_px: ArrayLike,
    more_px2: float = 0.0,
) -> Triangulation | None:
    """The point whose two images are most likely the measured ones (Gaussian pixel noise).

    Pixels (2,) are as recorded, distortion included; covariances (2, 2) px², to which `more_px2` comes in each
    coordinate.  None where no point in front of both eyes explains them.  Both pixels are moved, each as its
    covariance lets it, until their rays meet (Kanatani's optimal correction); in plain floats, which on vectors this
    short are several times as fast as arrays.
    """
    left, right = (
        _Pixel(view.left, left_px, cov_left_px, more_px2),
        _Pixel(view.right, right_px, cov_right_px, more_px2),
    )
    (u, v, w), (x, y, z) = left.center, right.center
    gap = x - u, y - v, z - w
    chi2 = _meet(left, right, gap)
    if chi2 is None:
        return None
    a, b = left.ray(), right.ray()
    normal = _cross(a, b)
    sine2 = _dot(normal, normal)
    if not sine2 > _PARALLEL * _dot(a, a) * _dot(b, b):
        return None
    depth_left, depth_right = _dot(_cross(gap, b), normal) / sine2, _dot(_cross(gap, a), normal) / sine2
    if not (depth_left > 0 and depth_right > 0):
        return None
    p_root = np.array((u + depth_left * a[0], v + depth_left * a[1], w + depth_left * a[2]))
    cov_root = _covariance(*left.slopes(depth_left), *right.slopes(depth_right))
    return Triangulation(p_root, cov_root, 0.5 * (left.moved2_px2 + right.moved2_px2) ** 0.5, chi2)


class _Pixel:
    """A pixel measured by one eye, with its covariance, and the ray (x, y, 1) of the pixel that it is moved to."""

    __slots__ = ("at", "axes", "camera", "center", "cov", "moved2_px2", "pull", "x", "y")

    def __init__(self, eye: View, pixel: ArrayLike, cov: ArrayLike, more_px2: float) -> None:
        camera, at = eye.camera, np.asarray(pixel, dtype=float)
        (uu, uv), (_, vv) = np.asarray(cov, dtype=float).tolist()
        self.camera, self.at, self.cov = camera, at.tolist(), (uu + more_px2, uv, vv + more_px2)
        (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = eye.pose
        self.axes, self.center = ((a, d, g), (b, e, h), (c, f, i)), (x, y, z)
        self.x, self.y = cv2.undistortPoints(at.reshape(1, 1, 2), camera.K, camera.lens)[0, 0].tolist()
        self.moved2_px2 = 0.0

    def ray(self) -> Vector:
        """In the root frame; its length is 1 along the optical axis."""
        return _turned(self.x, self.y, 1.0, self.axes)

    def look(self, slope: Vector) -> tuple[float, float]:
        """Of a constraint with that slope by the ray: how much further from it the measured pixel is than the ray,
        and how far noise takes it (variance).  NaN where the lens folds back."""
        u, v, ux, uy, vx, vy = self.camera.linearised(self.x, self.y)
        det = ux * vy - uy * vx
        if not det > 0:
            return math.nan, math.nan
        du, dv = self.at[0] - u, self.at[1] - v
        gx, gy = _dot(self.axes[0], slope), _dot(self.axes[1], slope)
        gu, gv = (vy * gx - vx * gy) / det, (ux * gy - uy * gx) / det
        uu, uv, vv = self.cov
        pu, pv = uu * gu + uv * gv, uv * gu + vv * gv
        self.pull = du, dv, pu, pv, ux / det, uy / det, vx / det, vy / det
        return gu * du + gv * dv, gu * pu + gv * pv

    def move(self, k: float) -> float:
        """Go where the pixel is, less `k` times what the constraint takes from it; returns how far (x, y) went."""
        du, dv, pu, pv, ux, uy, vx, vy = self.pull
        u, v = du - k * pu, dv - k * pv
        dx, dy = vy * u - uy * v, ux * v - vx * u
        self.x, self.y = self.x + dx, self.y + dy
        self.moved2_px2 = k * k * (pu * pu + pv * pv)
        return abs(dx) + abs(dy)

    def slopes(self, depth: float) -> tuple[Vector, Vector]:
        """∂pixel/∂p_root in units of its noise, 1/m, of a point that far ahead on the ray."""
        x, y = self.x, self.y
        _, _, ux, uy, vx, vy = self.camera.linearised(x, y)
        uu, uv, vv = self.cov
        tilt, first, second = uv / uu, depth * uu**0.5, depth * (vv - uv * uv / uu) ** 0.5
        wx, wy = (vx - tilt * ux) / second, (vy - tilt * uy) / second  # of v less what u tells of it: whitened
        ux, uy = ux / first, uy / first  # by Cholesky's factor
        return _turned(ux, uy, -(ux * x + uy * y), self.axes), _turned(wx, wy, -(wx * x + wy * y), self.axes)


def _meet(left: _Pixel, right: _Pixel, gap: Vector) -> float | None:
    """Move both pixels until their rays meet; returns what that costs (χ²), or None where they do not."""
    for _ in range(_ROUNDS):
        a, b = left.ray(), right.ray()
        plane = _cross(gap, a)  # it holds the gap and the left ray
        off_left, var_left = left.look(_cross(b, gap))
        off_right, var_right = right.look(plane)
        off, var = _dot(b, plane) + off_left + off_right, var_left + var_right
        if not var > 0:
            return None
        if left.move(off / var) + right.move(off / var) < _SETTLED:
            return off * off / var
    return None


def _covariance(a: Vector, b: Vector, c: Vector, d: Vector) -> Array:
    """(3, 3) inverse of aaᵀ + bbᵀ + ccᵀ + ddᵀ."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz) = a, b, c, d
    xx, xy, xz = (
        ax * ax + bx * bx + cx * cx + dx * dx,
        ax * ay + bx * by + cx * cy + dx * dy,
        ax * az + bx * bz + cx * cz + dx * dz,
    )
    yy, yz, zz = (
        ay * ay + by * by + cy * cy + dy * dy,
        ay * az + by * bz + cy * cz + dy * dz,
        az * az + bz * bz + cz * cz + dz * dz,
    )
    X, Y, Z = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * X + xy * Y + xz * Z
    X, Y, Z = X / det, Y / det, Z / det
    YY, YZ, ZZ = (xx * zz - xz * xz) / det, (xy * xz - xx * yz) / det, (xx * yy - xy * xy) / det
    return np.array(((X, Y, Z), (Y, YY, YZ), (Z, YZ, ZZ)))


def _turned(x: float, y: float, z: float, axes: tuple[Vector, Vector, Vector]) -> Vector:
    """x of the first axis, y of the second and z of the third."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    return x * a + y * d + z * g, x * b + y * e + z * h, x * c + y * f + z * i


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
