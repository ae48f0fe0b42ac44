"""Where two eyes' image points meet, and how well that is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.camera import Camera, StereoView
from pps_vision.types import Array

Vector = tuple[float, float, float]

_ROUNDS = 20  # two or three are usual; a strong lens takes more, for it is undone along the way
_SETTLED = 1e-7  # rad: what a round moves the rays shrinks about a thousandfold from one to the next
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
    view: StereoView, left_px: ArrayLike, right_px: ArrayLike, cov_left_px: ArrayLike, cov_right_px: ArrayLike
) -> Triangulation | None:
    """The point whose two images are most likely the measured ones (Gaussian pixel noise).

    Pixels (2,) are as recorded, distortion included; covariances (2, 2) px².  None where no
    point in front of both eyes explains them.  Both pixels are moved, each as its covariance lets it,
    until their rays meet (Kanatani's optimal correction); in plain floats, which on vectors this short
    are several times as fast as arrays.
    """
    R_root_left, R_root_right = view.left.T_root_camera[:3, :3], view.right.T_root_camera[:3, :3]
    axes = (R_root_right.T @ R_root_left).tolist()  # the right eye's, seen from the left one
    gap = ((view.right.center - view.left.center) @ R_root_left).tolist()
    left, right = _Pixel(view.left.camera, left_px, cov_left_px), _Pixel(view.right.camera, right_px, cov_right_px)
    chi2 = _meet(left, right, axes, gap)
    if chi2 is None:
        return None
    a, b = (left.x, left.y, 1.0), _turned(right.x, right.y, 1.0, axes)
    normal = _cross(a, b)
    sine2 = _dot(normal, normal)
    if not sine2 > _PARALLEL * _dot(a, a) * _dot(b, b):
        return None
    depth_left, depth_right = _dot(_cross(gap, b), normal) / sine2, _dot(_cross(gap, a), normal) / sine2
    if not (depth_left > 0 and depth_right > 0):
        return None
    p_root = view.left.center + R_root_left @ (depth_left * left.x, depth_left * left.y, depth_left)
    slopes = np.array([*left.slopes(depth_left), *(_turned(*row, axes) for row in right.slopes(depth_right))])
    cov_root = R_root_left @ _inverse(slopes.T @ slopes) @ R_root_left.T
    return Triangulation(p_root, cov_root, 0.5 * (left.moved2_px2 + right.moved2_px2) ** 0.5, chi2)


class _Pixel:
    """A measured pixel with its covariance, and the ray (x, y, 1) of the pixel that it is moved to."""

    __slots__ = ("at", "camera", "cov", "moved2_px2", "pull", "x", "y")

    def __init__(self, camera: Camera, pixel: ArrayLike, cov: ArrayLike) -> None:
        at = np.asarray(pixel, dtype=float)
        (uu, uv), (_, vv) = np.asarray(cov, dtype=float).tolist()
        self.camera, self.at, self.cov = camera, at.tolist(), (uu, uv, vv)
        self.x, self.y = cv2.undistortPoints(at.reshape(1, 1, 2), camera.K, camera.lens)[0, 0].tolist()
        self.moved2_px2 = 0.0

    def look(self, gx: float, gy: float) -> tuple[float, float]:
        """Of a constraint whose gradient by (x, y) is given: how much further from it the measured pixel is
        than the ray, and how far noise takes it (variance).  NaN where the lens folds back."""
        u, v, ux, uy, vx, vy = self.camera.linearised(self.x, self.y)
        det = ux * vy - uy * vx
        if not det > 0:
            return math.nan, math.nan
        du, dv = self.at[0] - u, self.at[1] - v
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
        """∂pixel/∂p in units of its noise, 1/m, of a point (camera coordinates) that far ahead on the ray."""
        _, _, ux, uy, vx, vy = self.camera.linearised(self.x, self.y)
        uu, uv, vv = self.cov
        tilt, first, second = uv / uu, depth * uu**0.5, depth * (vv - uv * uv / uu) ** 0.5
        wx, wy = vx - tilt * ux, vy - tilt * uy  # of v less what u tells of it: whitened by Cholesky's factor
        of_u = ux / first, uy / first, -(ux * self.x + uy * self.y) / first
        of_v = wx / second, wy / second, -(wx * self.x + wy * self.y) / second
        return of_u, of_v


def _meet(left: _Pixel, right: _Pixel, axes: list[list[float]], gap: list[float]) -> float | None:
    """Move both pixels until their rays meet; returns what that costs (χ²), or None where they do not."""
    for _ in range(_ROUNDS):
        ray = _turned(right.x, right.y, 1.0, axes)
        plane = _cross(gap, (left.x, left.y, 1.0))  # it holds the gap and the left ray
        by_left = _cross(ray, gap)
        off_left, var_left = left.look(by_left[0], by_left[1])
        off_right, var_right = right.look(_dot(axes[0], plane), _dot(axes[1], plane))
        off, var = _dot(ray, plane) + off_left + off_right, var_left + var_right
        if not var > 0:
            return None
        if left.move(off / var) + right.move(off / var) < _SETTLED:
            return off * off / var
    return None


def _turned(x: float, y: float, z: float, axes: list[list[float]]) -> Vector:
    """x of the first axis, y of the second and z of the third."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    return x * a + y * d + z * g, x * b + y * e + z * h, x * c + y * f + z * i


def _cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _inverse(M: Array) -> Array:
    """Of a symmetric matrix (3, 3)."""
    a, b, c = M.tolist()
    adjugate = _cross(b, c), _cross(c, a), _cross(a, b)
    inverse: Array = np.array(adjugate) / _dot(a, adjugate[0])
    return inverse
