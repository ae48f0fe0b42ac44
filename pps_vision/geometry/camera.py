"""Cameras: OpenCV's pinhole and fisheye lenses, a camera at a pose, a stereo pair, a stereo rig.

`Camera` takes points in camera coordinates, `View` in the root frame.  Both project with the same compiled code:

| purpose | method |
|---|---|
| pixels of any number of points, as an array | `project` |
| pixel of one point with its gradients, in plain floats (10 times as fast as an array of one) | `project_linearised` |
| Jacobian of the pixel of one point, as an array | `project_jacobian` |
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from pps_vision.geometry.compiled import Lens, Linearised, Pose, Vector, projected, projected_from, projected_points
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.jit import njit
from pps_vision.types import Array, Image, StereoFrame

_GRID = 17  # pixels a side at which `is_usable` tests a lens
_INVERTED_PX = 1.0  # largest error of distorting an undistorted pixel
_NARROWEST_RAD = 0.01  # smallest field of view of a camera
_COEFFICIENTS = (5, 8, 12, 14)  # of OpenCV's models of a lens
_FISHEYE_COEFFICIENTS = (4,)
_FISHEYE_TESTED_RAD = np.deg2rad(80.0)  # from the axis, beyond which points are too far aside to be followed
_FISHEYE_ITERATIONS = 20
_FLAT = 1e-6  # smallest slope that Newton's method divides by
_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)


@dataclass(frozen=True)
class Camera:
    """Intrinsics: focal lengths and principal point in pixels, and the lens.

    `distortion`: OpenCV's 5, 8, 12 or 14 coefficients k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, τx, τy (radial,
    tangential, rational, thin prism, tilted sensor); with `fisheye` its 4 of that model, k1 to k4.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    fisheye: bool = False

    def __post_init__(self) -> None:
        lengths = _FISHEYE_COEFFICIENTS if self.fisheye else _COEFFICIENTS
        if len(self.distortion) not in lengths:
            raise ValueError(
                f"{len(self.distortion)} distortion coefficients: expected {' or '.join(map(str, lengths))}"
            )
        if not (self.fx > 0 and self.fy > 0 and self.width > 0 and self.height > 0):
            numbers = f"camera {self.width}×{self.height}, focal lengths {self.fx}, {self.fy}"
            raise ValueError(f"{numbers}: expected positive numbers")

    @cached_property
    def K(self) -> Array:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @cached_property
    def lens(self) -> Array:
        """(n,) distortion, as OpenCV takes it."""
        return np.array(self.distortion)

    @cached_property
    def numbers(self) -> Lens:
        """Intrinsics, distortion and `_r2_max` in plain floats, as the compiled functions take them."""
        focal = float(self.fx), float(self.fy), float(self.cx), float(self.cy)
        if self.fisheye:
            k1, k2, k3, k4 = map(float, self.distortion)
            return (*focal, k1, k2, 0.0, 0.0, k3, self._r2_max, k4, *[0.0] * 8, 1.0)
        coefficients = (*focal, *map(float, self.distortion[:5]), self._r2_max)
        if len(self.distortion) == _COEFFICIENTS[0]:
            return coefficients
        return (*coefficients, *map(float, self.distortion[5:]), *[0.0] * (15 - len(self.distortion)))

    @cached_property
    def _r2_max(self) -> float:
        """Squared normalised radius up to which the radial distortion is one-to-one: the smallest positive root of the
        derivative by r of r·(1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), or the pole before it."""
        if self.fisheye:
            angle2_max = _smallest_root(
                Polynomial([1.0, *(n * k for n, k in zip((3, 5, 7, 9), self.distortion, strict=True))])
            )
            return float(np.tan(np.sqrt(angle2_max)) ** 2) if angle2_max < (np.pi / 2) ** 2 else np.inf
        k1, k2, _, _, k3, k4, k5, k6 = (*self.distortion, 0.0, 0.0, 0.0)[:8]
        above, below = Polynomial([1.0, k1, k2, k3]), Polynomial([1.0, k4, k5, k6])
        r2 = Polynomial([0.0, 2.0])
        slope = (above + r2 * above.deriv()) * below - r2 * above * below.deriv()
        return min(_smallest_root(slope), _smallest_root(below))

    @cached_property
    def _image_radius(self) -> Polynomial:
        """Distance from the image's centre of a point at an angle from a fisheye's axis, in focal lengths."""
        return Polynomial(np.insert([1.0, *self.distortion], range(5), 0.0))

    @cached_property
    def _largest_angle(self) -> float:
        """Angle from a fisheye's axis at which its image folds back, at most π."""
        return float(min(_smallest_root(Polynomial(self._image_radius.deriv().coef[::2])) ** 0.5, np.pi))

    def project(self, points: ArrayLike) -> Array:
        """Pixels (…, 2) of points (…, 3) in camera coordinates; NaN where they cannot be seen
        (behind the camera, or so far aside that the distortion model folds back)."""
        p = np.asarray(points, dtype=float)
        return projected_points(self.numbers, np.ascontiguousarray(p.reshape(-1, 3))).reshape(*p.shape[:-1], 2)

    def project_linearised(self, X: float, Y: float, Z: float) -> Linearised:
        """Pixel u, v of one point and the gradients of u and v by its coordinates (px/m); NaN if it cannot be seen."""
        return projected(self.numbers, X, Y, Z)

    def bearings(self, pixels: ArrayLike) -> Array:
        """Unit viewing directions (…, 3) in camera coordinates of pixels (…, 2)."""
        px = np.asarray(pixels, dtype=float)
        flat = px.reshape(-1, 1, 2)
        if self.fisheye:
            rays = self._fisheye_bearings(flat[:, 0])
        else:
            xy = cv2.undistortPointsIter(flat, self.K, self.lens, np.eye(3), np.eye(3), _UNDISTORT)
            rays = np.concatenate([xy.reshape(-1, 2), np.ones((len(flat), 1))], axis=1)
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays.reshape(*px.shape[:-1], 3)

    def _fisheye_bearings(self, pixels: Array) -> Array:
        """Unit viewing directions (n, 3) of pixels (n, 2) at the angle θ from the axis where
        |x| = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), by Newton's method; beyond the lens's largest angle at that one."""
        x = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        radius = np.hypot(x[:, 0], x[:, 1])
        image_radius = self._image_radius
        slope = image_radius.deriv()
        angle = np.minimum(radius, self._largest_angle)
        for _ in range(_FISHEYE_ITERATIONS):
            step = (image_radius(angle) - radius) / np.maximum(slope(angle), _FLAT)
            angle = np.clip(angle - step, 0.0, self._largest_angle)
        aside = np.sin(angle) / np.where(radius > 0, radius, 1.0)
        return np.column_stack([x * aside[:, None], np.cos(angle)])

    def bearing_map(self, top: int = 0, bottom: int | None = None) -> Array:
        """(n, width, 3) viewing direction of every pixel centre of the rows from `top` to `bottom`, by default all."""
        v, u = np.mgrid[top : self.height if bottom is None else bottom, : self.width]
        return self.bearings(np.stack([u, v], axis=-1))

    def is_usable(self) -> bool:
        """Whether, all over the image, a pixel's bearing projects back to it (within 1 px) and bearings
        differ from each other, as they cannot with absurd intrinsics or a distortion that folds back.  Of a fisheye
        lens, whose image may be a disc, the pixels within 80° of the axis count, if they are at least half of all."""
        grid = np.meshgrid(np.linspace(0, self.width - 1, _GRID), np.linspace(0, self.height - 1, _GRID))
        pixels = np.stack(grid, axis=-1)
        try:
            with np.errstate(all="ignore"):  # absurd numbers overflow
                rays = self.bearings(pixels)
                errors_px = np.abs(self.project(rays) - pixels).max(axis=-1)
                is_tested = (
                    rays[..., 2] > np.cos(_FISHEYE_TESTED_RAD) if self.fisheye else np.full(errors_px.shape, True)
                )
                error_px = errors_px[is_tested].max() if np.mean(is_tested) >= 0.5 else np.inf
                across_rad, down_rad = np.linalg.norm([rays[0, -1] - rays[0, 0], rays[-1, 0] - rays[0, 0]], axis=1)
        except np.linalg.LinAlgError:  # coefficients beyond any number
            return False
        return bool(error_px < _INVERTED_PX and min(across_rad, down_rad) > _NARROWEST_RAD)  # False for NaN

    def reduced(self, k: int) -> "Camera":
        """The same camera with pixels `k` times as large: the first covers the `k` × `k` at the top left."""
        cx = (self.cx + 0.5) / k - 0.5
        cy = (self.cy + 0.5) / k - 0.5
        width, height = self.width // k, self.height // k
        return replace(self, width=width, height=height, fx=self.fx / k, fy=self.fy / k, cx=cx, cy=cy)

    def stretched(self, width: int, height: int) -> "Camera":
        """The same camera with another number of columns and rows."""
        across, down = width / self.width, height / self.height
        cx, cy = (self.cx + 0.5) * across - 0.5, (self.cy + 0.5) * down - 0.5
        return replace(self, width=width, height=height, fx=self.fx * across, fy=self.fy * down, cx=cx, cy=cy)

    @cached_property
    def field_of_view_deg(self) -> float:
        """Horizontal, through the lens."""
        edges = self.bearings([(-0.5, self.cy), (self.width - 0.5, self.cy)])
        return float(np.rad2deg(np.arccos(edges[:, 2]).sum()))

    @cached_property
    def focal_px(self) -> float:
        """Geometric mean focal length: pixels per radian at the image centre."""
        return float(np.sqrt(self.fx * self.fy))

    def contains(self, pixel: Array | tuple[float, float], margin_px: float = 0.0) -> bool:
        """Whether a pixel (2,) lies at least `margin_px` inside the image; False for NaN."""
        u, v = pixel
        m = margin_px - 0.5
        return bool(m <= u <= self.width - 1 - m and m <= v <= self.height - 1 - m)


def _smallest_root(polynomial: Polynomial) -> float:
    """The smallest positive real root, infinity where there is none."""
    roots = polynomial.trim().roots()
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
    return float(real.min()) if real.size else np.inf


def reduced_image(image: Image, k: int) -> Image:
    """An image (h, w) or (h, w, 3) as `Camera.reduced(k)` takes it: the mean of each block of k × k pixels."""
    if k == 1:
        return image
    height, width = (side // k for side in image.shape[:2])
    return np.asarray(cv2.resize(image[: k * height, : k * width], (width, height), interpolation=cv2.INTER_AREA))


def solid_angles(bearings: Array) -> Array:
    """(h, w) solid angle (sr) of the pixels of neighbouring viewing directions (h, w, 3)."""
    dv, du = np.gradient(bearings, axis=(0, 1))
    return np.linalg.norm(np.cross(du, dv), axis=-1)


@dataclass(frozen=True)
class View:
    """A camera at a pose: projects root-frame points and casts root-frame rays."""

    camera: Camera
    T_root_camera: Array

    @cached_property
    def T_camera_root(self) -> Array:
        """The inverse pose."""
        return inverse(self.T_root_camera)

    @property
    def center(self) -> Array:
        """(3,) the optical centre in the root frame."""
        return self.T_root_camera[:3, 3]

    @property
    def place(self) -> Vector:
        """The optical centre in plain floats."""
        pose = self.pose
        return pose[3], pose[7], pose[11]

    def project(self, points_root: ArrayLike) -> Array:
        """Pixels (…, 2) of root-frame points (…, 3); NaN where they cannot be seen."""
        points = np.asarray(points_root, dtype=float)
        if points.ndim == 1:
            return np.array(self.project_linearised(*points.tolist())[:2])
        return self.camera.project(move_points(self.T_camera_root, points))

    def project_linearised(self, x: float, y: float, z: float) -> Linearised:
        """Pixel u, v of one point and the gradients of u and v by its coordinates (px/m); NaN if it cannot be seen."""
        return projected_from(self.pose, self.camera.numbers, x, y, z)

    def project_jacobian(self, point_root: ArrayLike) -> Array:
        """∂pixel/∂p_root (2, 3), px/m; NaN where it cannot be seen."""
        return np.array(self.project_linearised(*np.asarray(point_root, dtype=float).tolist())[2:])

    @cached_property
    def pose(self) -> Pose:
        """The first three rows of `T_root_camera` in plain floats."""
        a, b, c, x, d, e, f, y, g, h, i, z = self.T_root_camera[:3].ravel().tolist()
        return a, b, c, x, d, e, f, y, g, h, i, z

    def rays(self, pixels: ArrayLike) -> Array:
        """Unit viewing directions (…, 3) in the root frame."""
        return self.camera.bearings(pixels) @ self.T_root_camera[:3, :3].T

    def sees(self, point_root: ArrayLike, margin_px: float = 0.0) -> bool:
        """Whether a root-frame point projects inside the image."""
        return self.camera.contains(self.project(point_root), margin_px)


@dataclass(frozen=True)
class StereoView:
    """Both cameras at one instant."""

    left: View
    right: View

    @property
    def midpoint(self) -> Array:
        """(3,) m, midway between the cameras."""
        return 0.5 * (self.left.center + self.right.center)

    @cached_property
    def centers(self) -> Array:
        """(2, 3) m, the left and the right camera's."""
        return np.stack([self.left.center, self.right.center])

    @property
    def axes_angle_rad(self) -> float:
        """Angle between both optical axes."""
        return float(np.arccos(np.clip(self.left.T_root_camera[:3, 2] @ self.right.T_root_camera[:3, 2], -1, 1)))


@njit(cache=True, error_model="numpy")
def sight(centers: Array, p_root: Array) -> Array:
    """(3,) m: the mean direction of a point (3,) from cameras at `centers` (2, 3), as long as its mean distance.

    From cameras side by side it is the vector from their midpoint; cameras that face each other have that beside the
    point."""
    line = np.zeros(3)
    mean_m = 0.0
    for k in range(2):
        x, y, z = p_root[0] - centers[k, 0], p_root[1] - centers[k, 1], p_root[2] - centers[k, 2]
        distance_m = math.sqrt(x * x + y * y + z * z)
        mean_m += 0.5 * distance_m
        line[0] += x / distance_m
        line[1] += y / distance_m
        line[2] += z / distance_m
    scale = mean_m / math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
    for i in range(3):
        line[i] *= scale
    return line


@dataclass(frozen=True)
class StereoRig:
    """Two cameras and their poses for given joints.

    `eye_poses(joints)` returns (T_root_left, T_root_right); a fixed pair ignores its argument.
    """

    left: Camera
    right: Camera
    eye_poses: Callable[[Array | None], tuple[Array, Array]]

    @classmethod
    def fixed(cls, left: Camera, right: Camera, T_left_right: Array) -> "StereoRig":
        """A rig that does not move; the root frame is the left camera's."""
        poses = (np.eye(4), np.asarray(T_left_right, dtype=float))
        return cls(left, right, lambda _: poses)

    def reduced(self, k: int) -> "StereoRig":
        """The same rig with pixels `k` times as large."""
        return StereoRig(self.left.reduced(k), self.right.reduced(k), self.eye_poses)

    def view(self, joints_left: Array | None = None, joints_right: Array | None = None) -> StereoView:
        """Both cameras, each at its own joints (`joints_right` defaults to `joints_left`)."""
        T_root_left, T_root_right = self.eye_poses(joints_left)
        if joints_right is not None and (joints_left is None or not np.array_equal(joints_right, joints_left)):
            T_root_right = self.eye_poses(joints_right)[1]
        return StereoView(View(self.left, T_root_left), View(self.right, T_root_right))

    def view_of(self, frame: StereoFrame) -> StereoView:
        """Both cameras at the stamps of the frame's images."""
        return self.view(frame.joints_left_rad, frame.joints_right_rad)
