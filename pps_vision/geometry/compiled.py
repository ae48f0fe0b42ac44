"""Projection and triangulation of single points, compiled by numba.

A function is compiled at its first call, which takes seconds once, and cached beside this file.  Functions here call
none of another file, because numba's cache does not notice when that one changes.
"""

import math

import numpy as np

from pps_vision.jit import njit
from pps_vision.types import Array

Point = tuple[float, float]
Vector = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]  # upper half of a matrix (3, 3), row by row
Pull = tuple[float, float, float, float, float, float, float, float]
Lens = tuple[float, ...]
"""fx, fy, cx, cy px; k1, k2, p1, p2, k3 as OpenCV's; the squared radius (of x = X/Z, y = Y/Z) where it folds back.
With 20 numbers also k4, k5, k6, s1, s2, s3, s4, τx, τy, and 1 for a fisheye (its k3, k4 in their places) or 0.  The
short form is compiled for itself: the usual lens pays nothing for the others."""
Pose = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""The first three rows of `T_root_camera`."""
Linearised = tuple[float, float, Vector, Vector]  # a pixel u, v, and the gradients of u and v by the point (px/m)
Sighting = tuple[Pose, Lens, float, float, float, float, float]
"""Pose and lens of a camera, the measured pixel u, v, and its covariance uu, uv, vv (px²)."""

_ITERATIONS = 20  # of Kanatani's correction: 2 are usual, a strong lens takes more
_CONVERGED_RAD = 1e-5  # of one iteration; convergence is quadratic, so about 1e-11 is left
PARALLEL = 1e-10  # squared sine of the angle between rays that count as parallel
_UNDISTORT_ITERATIONS = 5  # the correction above finishes the inversion
_WIDEST_RAD = math.radians(89)
SHORT = 10
"""Numbers of a lens of 5 coefficients."""


@njit(cache=True, error_model="numpy")
def distorted(lens: Lens, x: float, y: float) -> tuple[float, float, float, float, float, float]:
    """Pixel u, v of a normalised point (X/Z, Y/Z), and ∂u/∂x, ∂u/∂y, ∂v/∂x, ∂v/∂y (px); no test of the fold."""
    fx, fy, cx, cy, p1, p2 = lens[0], lens[1], lens[2], lens[3], lens[6], lens[7]
    x2, xy, y2 = x * x, x * y, y * y
    r2 = x2 + y2
    radial, slope = _radial(lens, r2)  # ∂radial/∂x = slope·x
    across = slope * xy + 2 * (p1 * x + p2 * y)  # ∂(distorted y)/∂x, and of x by y
    u, v = x * radial + 2 * p1 * xy + p2 * (r2 + 2 * x2), y * radial + 2 * p2 * xy + p1 * (r2 + 2 * y2)
    ux, uy = radial + slope * x2 + 2 * p1 * y + 6 * p2 * x, across
    vx, vy = across, radial + slope * y2 + 6 * p1 * y + 2 * p2 * x
    if len(lens) > SHORT:
        s1, s2, s3, s4 = _at(lens, 13), _at(lens, 14), _at(lens, 15), _at(lens, 16)
        u, v = u + r2 * (s1 + r2 * s2), v + r2 * (s3 + r2 * s4)
        of_u, of_v = 2 * (s1 + 2 * r2 * s2), 2 * (s3 + 2 * r2 * s4)
        ux, uy, vx, vy = ux + of_u * x, uy + of_u * y, vx + of_v * x, vy + of_v * y
        sin_x, cos_x, sin_y, cos_y = _tilt(lens)
        w = 1 / (sin_y * u - cos_y * sin_x * v + cos_x * cos_y)  # rows (cos τx, 0, 0), (-sin τx sin τy, cos τy, 0), 1/w
        u, v = w * cos_x * u, w * (cos_y * v - sin_x * sin_y * u)
        a, b = w * (cos_x - u * sin_y), w * u * cos_y * sin_x
        c, d = -w * sin_y * (sin_x + v), w * cos_y * (1 + v * sin_x)
        ux, uy, vx, vy = a * ux + b * vx, a * uy + b * vy, c * ux + d * vx, c * uy + d * vy
    return fx * u + cx, fy * v + cy, fx * ux, fx * uy, fy * vx, fy * vy


@njit(cache=True, error_model="numpy")
def _radial(lens: Lens, r2: float) -> Point:
    """The factor by which a point at the squared radius `r2` moves outwards, and twice its derivative by `r2`."""
    k1, k2, k3 = lens[4], lens[5], lens[8]
    if len(lens) > SHORT and _at(lens, 19) == 1:
        if r2 < 1e-16:
            return 1.0, 0.0
        r = math.sqrt(r2)
        angle = math.atan(r)
        a2, k4 = angle * angle, _at(lens, 10)
        factor = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) / r
        by_r = (1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))) / (1 + r2)
        return factor, (by_r - factor) / r2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    if len(lens) > SHORT:
        k4, k5, k6 = _at(lens, 10), _at(lens, 11), _at(lens, 12)
        below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = radial / below
        slope = (slope - radial * 2 * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / below
    return radial, slope


@njit(cache=True, error_model="numpy")
def _at(lens: Lens, index: int) -> float:
    """A number that the short form lacks; by a variable, because the compiler would check a constant there too."""
    return lens[index]


@njit(cache=True, error_model="numpy")
def _tilt(lens: Lens) -> tuple[float, float, float, float]:
    """Sine and cosine of the angles τx and τy of a tilted sensor (Scheimpflug)."""
    x, y = _at(lens, 17), _at(lens, 18)
    return math.sin(x), math.cos(x), math.sin(y), math.cos(y)


@njit(cache=True, error_model="numpy")
def projected(lens: Lens, X: float, Y: float, Z: float) -> Linearised:
    """Projection of a point in camera coordinates; NaN behind the camera and where the distortion folds back."""
    if Z > 1e-9:
        x, y = X / Z, Y / Z
        if x * x + y * y < lens[9]:
            u, v, ux, uy, vx, vy = distorted(lens, x, y)
            return u, v, (ux / Z, uy / Z, -(ux * x + uy * y) / Z), (vx / Z, vy / Z, -(vx * x + vy * y) / Z)
    nan = math.nan
    return nan, nan, (nan, nan, nan), (nan, nan, nan)


@njit(cache=True, error_model="numpy")
def projected_points(lens: Lens, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in camera coordinates, as `projected`."""
    pixels = np.empty((len(points), 2))
    for k in range(len(points)):
        u, v, _, _ = projected(lens, points[k, 0], points[k, 1], points[k, 2])
        pixels[k, 0], pixels[k, 1] = u, v
    return pixels


@njit(cache=True, error_model="numpy")
def projected_from(pose: Pose, lens: Lens, x: float, y: float, z: float) -> Linearised:
    """Projection of a point in the root frame by a camera at a pose."""
    a, b, c, px, d, e, f, py, g, h, i, pz = pose
    x, y, z = x - px, y - py, z - pz
    X, Y, Z = a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z
    u, v, of_u, of_v = projected(lens, X, Y, Z)
    return u, v, _turned(pose, of_u[0], of_u[1], of_u[2]), _turned(pose, of_v[0], of_v[1], of_v[2])


@njit(cache=True, error_model="numpy")
def triangulated(left: Sighting, right: Sighting) -> tuple[bool, Vector, Symmetric, float, float]:
    """Triangulation after Kanatani: the pixels move by the least Mahalanobis distance that makes their rays meet.

    Returns whether they meet in front of both cameras; the point; its covariance; the squared length of the
    correction (px²); and its squared Mahalanobis distance (χ²).
    """
    nothing = False, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0
    p, q = left[0], right[0]
    gap = q[3] - p[3], q[7] - p[7], q[11] - p[11]
    x, y = _undistorted(left), _undistorted(right)
    for _ in range(_ITERATIONS):
        a, b = _turned(p, x[0], x[1], 1.0), _turned(q, y[0], y[1], 1.0)
        plane = _cross(gap, a)  # normal of the epipolar plane of the left ray
        off_left, var_left, pull_left = _linearise(left, x, _cross(b, gap))
        off_right, var_right, pull_right = _linearise(right, y, plane)
        off, var = _dot(b, plane) + off_left + off_right, var_left + var_right
        x, far_left, moved2_left = _moved(x, pull_left, off / var)
        y, far_right, moved2_right = _moved(y, pull_right, off / var)
        converged = far_left + far_right < _CONVERGED_RAD
        if converged:
            break
    a, b = _turned(p, x[0], x[1], 1.0), _turned(q, y[0], y[1], 1.0)
    normal = _cross(a, b)
    sine2 = _dot(normal, normal)
    if not (converged and sine2 > PARALLEL * _dot(a, a) * _dot(b, b)):
        return nothing
    depth_left, depth_right = _dot(_cross(gap, b), normal) / sine2, _dot(_cross(gap, a), normal) / sine2
    if not (depth_left > 0 and depth_right > 0):
        return nothing
    at = p[3] + depth_left * a[0], p[7] + depth_left * a[1], p[11] + depth_left * a[2]
    u, v = _slopes(left, x, depth_left)
    s, t = _slopes(right, y, depth_right)
    return True, at, _inverse(u, v, s, t), moved2_left + moved2_right, off * off / var


@njit(cache=True, error_model="numpy")
def triangulated_points(
    p: Pose, left: Lens, q: Pose, right: Lens, pixels: Array, covs: Array
) -> tuple[Array, Array, Array]:
    """`triangulated` for pixels (n, 4) u, v of both cameras with covariances (n, 6) uu, uv, vv of both: points (n, 3),
    covariances (n, 3, 3) and RMS reprojection errors (n,) px, NaN where the rays do not meet."""
    n = len(pixels)
    points, cov, residuals = np.full((n, 3), math.nan), np.full((n, 3, 3), math.nan), np.full(n, math.nan)
    for k in range(n):
        (u, v, s, t), (a, b, c, d, e, f) = pixels[k], covs[k]
        meet, at, (xx, xy, xz, yy, yz, zz), moved2, _ = triangulated(
            (p, left, u, v, a, b, c), (q, right, s, t, d, e, f)
        )
        if meet:
            points[k] = at
            cov[k] = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
            residuals[k] = 0.5 * math.sqrt(moved2)
    return points, cov, residuals


@njit(cache=True, error_model="numpy")
def _undistorted(eye: Sighting) -> Point:
    """Approximate normalised point of the pixel, by fixed-point iteration."""
    lens = eye[1]
    p1, p2 = lens[6], lens[7]
    u, v = (eye[2] - lens[2]) / lens[0], (eye[3] - lens[3]) / lens[1]
    s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0
    if len(lens) > SHORT:
        if _at(lens, 19) == 1:
            return _fisheye_undistorted(lens, u, v)
        s1, s2, s3, s4 = _at(lens, 13), _at(lens, 14), _at(lens, 15), _at(lens, 16)
        sin_x, cos_x, sin_y, cos_y = _tilt(lens)
        u = u / cos_x
        v = (v + sin_x * sin_y * u) / cos_y
        w = cos_x * cos_y / (1 - sin_y * u + cos_y * sin_x * v)
        u, v = w * u, w * v
    x, y = u, v
    for _ in range(_UNDISTORT_ITERATIONS):
        r2 = x * x + y * y
        radial = _radial(lens, r2)[0]
        x, y = (
            (u - 2 * p1 * x * y - p2 * (r2 + 2 * x * x) - r2 * (s1 + r2 * s2)) / radial,
            (v - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y - r2 * (s3 + r2 * s4)) / radial,
        )
    return x, y


@njit(cache=True, error_model="numpy")
def _fisheye_undistorted(lens: Lens, u: float, v: float) -> Point:
    """The same of a fisheye lens, by Newton's method for the angle from the axis; at most 89° from it."""
    k1, k2, k3, k4 = lens[4], lens[5], lens[8], _at(lens, 10)
    radius = math.hypot(u, v)
    angle = min(radius, _WIDEST_RAD)
    for _ in range(2 * _UNDISTORT_ITERATIONS):
        a2 = angle * angle
        slope = 1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
        image_radius = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        angle = min(max(angle - (image_radius - radius) / slope, 0.0), _WIDEST_RAD)
    outwards = math.tan(angle) / radius if radius > 0 else 1.0
    return outwards * u, outwards * v


@njit(cache=True, error_model="numpy")
def _linearise(eye: Sighting, x: Point, slope: Vector) -> tuple[float, float, Pull]:
    """The epipolar constraint, linearised at the ray `x`, where `slope` is its gradient by the ray.

    Returns its change from ray to measured pixel, its variance, and input of `_moved`; NaN where the lens folds back.
    """
    pose, lens, at_u, at_v, uu, uv, vv = eye
    u, v, ux, uy, vx, vy = distorted(lens, x[0], x[1])
    det = ux * vy - uy * vx if x[0] * x[0] + x[1] * x[1] < lens[9] else math.nan
    du, dv = at_u - u, at_v - v
    gx = pose[0] * slope[0] + pose[4] * slope[1] + pose[8] * slope[2]
    gy = pose[1] * slope[0] + pose[5] * slope[1] + pose[9] * slope[2]
    gu, gv = (vy * gx - vx * gy) / det, (ux * gy - uy * gx) / det
    pu, pv = uu * gu + uv * gv, uv * gu + vv * gv
    return gu * du + gv * dv, gu * pu + gv * pv, (du, dv, pu, pv, ux / det, uy / det, vx / det, vy / det)


@njit(cache=True, error_model="numpy")
def _moved(x: Point, pull: Pull, k: float) -> tuple[Point, float, float]:
    """The normalised point moved by `k` times its pull; its distance from `x`, and the pixel's, squared (px²)."""
    du, dv, pu, pv, ux, uy, vx, vy = pull
    u, v = du - k * pu, dv - k * pv
    dx, dy = vy * u - uy * v, ux * v - vx * u
    return (x[0] + dx, x[1] + dy), abs(dx) + abs(dy), k * k * (pu * pu + pv * pv)


@njit(cache=True, error_model="numpy")
def _slopes(eye: Sighting, at: Point, depth: float) -> tuple[Vector, Vector]:
    """∂pixel/∂p_root (1/m) of a point at `depth` on the ray, whitened by Cholesky's factor of the pixel covariance."""
    pose, lens, _, _, uu, uv, vv = eye
    x, y = at
    _, _, ux, uy, vx, vy = distorted(lens, x, y)
    tilt, first, second = uv / uu, depth * math.sqrt(uu), depth * math.sqrt(vv - uv * uv / uu)
    wx, wy = (vx - tilt * ux) / second, (vy - tilt * uy) / second  # v given u
    ux, uy = ux / first, uy / first
    return _turned(pose, ux, uy, -(ux * x + uy * y)), _turned(pose, wx, wy, -(wx * x + wy * y))


@njit(cache=True, error_model="numpy")
def _inverse(a: Vector, b: Vector, c: Vector, d: Vector) -> Symmetric:
    """The upper half, row by row, of the inverse of aaᵀ + bbᵀ + ccᵀ + ddᵀ."""
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
    return (
        *(X / det, Y / det, Z / det),
        *((xx * zz - xz * xz) / det, (xy * xz - xx * yz) / det, (xx * yy - xy * xy) / det),
    )


@njit(cache=True, error_model="numpy")
def _turned(pose: Pose, x: float, y: float, z: float) -> Vector:
    """A vector from camera to root axes."""
    a, b, c, _, d, e, f, _, g, h, i, _ = pose
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


@njit(cache=True, error_model="numpy")
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
