"""Cameras: pinhole with OpenCV's lens distortion, a camera at a pose, a stereo pair, a stereo rig.

`Camera` takes points in camera coordinates, `View` in the root frame.  Both project with the same compiled code:

| purpose | method |
|---|---|
| pixels of any number of points, as an array | `project` |
| pixel of one point with its gradients, in plain floats (10 times as fast as an array of one) | `project_linearised` |
| Jacobian of the pixel of one point, as an array | `project_jacobian` |
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.compiled import Lens, Linearised, Pose, Vector, projected, projected_from, projected_points
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.types import Array, Image, StereoFrame

_GRID = 17  # pixels a side at which `is_usable` tests a lens
_INVERTED_PX = 1.0  # largest error of distorting an undistorted pixel
_NARROWEST_RAD = 0.01  # smallest field of view of a camera
_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)


@dataclass(frozen=True)
class Camera:
    """Intrinsics: focal lengths and principal point in pixels, distortion (k1, k2, p1, p2, k3)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not (self.fx > 0 and self.fy > 0 and self.width > 0 and self.height > 0):
            numbers = f"camera {self.width}×{self.height}, focal lengths {self.fx}, {self.fy}"
            raise ValueError(f"{numbers}: expected positive numbers")

    @cached_property
    def K(self) -> Array:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @cached_property
    def lens(self) -> Array:
        """(5,) distortion, as OpenCV takes it."""
        return np.array(self.distortion)

    @cached_property
    def numbers(self) -> Lens:
        """Intrinsics, distortion and `_r2_max` in plain floats, as the compiled functions take them."""
        k1, k2, p1, p2, k3 = map(float, self.distortion)
        return float(self.fx), float(self.fy), float(self.cx), float(self.cy), k1, k2, p1, p2, k3, self._r2_max

    @cached_property
    def _r2_max(self) -> float:
        """Squared normalised radius up to which the distortion is one-to-one: the smallest positive root of
        d(r·radial(r²))/dr = 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶."""
        k1, k2, _, _, k3 = self.distortion
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
        real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
        return float(real.min()) if real.size else np.inf

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
        xy = cv2.undistortPointsIter(flat, self.K, self.lens, np.eye(3), np.eye(3), _UNDISTORT)
        rays = np.concatenate([xy.reshape(-1, 2), np.ones((len(flat), 1))], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays.reshape(*px.shape[:-1], 3)

    def bearing_map(self, top: int = 0, bottom: int | None = None) -> Array:
        """(n, width, 3) viewing direction of every pixel centre of the rows from `top` to `bottom`, by default all."""
        v, u = np.mgrid[top : self.height if bottom is None else bottom, : self.width]
        return self.bearings(np.stack([u, v], axis=-1))

    def solid_angle_map(self) -> Array:
        """(height, width) solid angle (sr) that each pixel covers."""
        return solid_angles(self.bearing_map())

    def is_usable(self) -> bool:
        """Whether, all over the image, a pixel's bearing projects back to it (within 1 px) and bearings
        differ from each other, as they cannot with absurd intrinsics or a distortion that folds back."""
        grid = np.meshgrid(np.linspace(0, self.width - 1, _GRID), np.linspace(0, self.height - 1, _GRID))
        pixels = np.stack(grid, axis=-1)
        try:
            with np.errstate(all="ignore"):  # absurd numbers overflow
                rays = self.bearings(pixels)
                error_px = np.abs(self.project(rays) - pixels).max()
                across_rad, down_rad = np.linalg.norm([rays[0, -1] - rays[0, 0], rays[-1, 0] - rays[0, 0]], axis=1)
        except np.linalg.LinAlgError:  # coefficients beyond any number
            return False
        return bool(error_px < _INVERTED_PX and min(across_rad, down_rad) > _NARROWEST_RAD)  # False for NaN

    def reduced(self, k: int) -> "Camera":
        """The same camera with pixels `k` times as large: the first covers the `k` × `k` at the top left."""
        cx = (self.cx + 0.5) / k - 0.5
        cy = (self.cy + 0.5) / k - 0.5
        return Camera(self.width // k, self.height // k, self.fx / k, self.fy / k, cx, cy, self.distortion)

    def stretched(self, width: int) -> "Camera":
        """The same camera with another number of columns."""
        scale = width / self.width
        return replace(self, width=width, fx=self.fx * scale, cx=(self.cx + 0.5) * scale - 0.5)

    @cached_property
    def focal_px(self) -> float:
        """Geometric mean focal length: pixels per radian at the image centre."""
        return float(np.sqrt(self.fx * self.fy))

    def contains(self, pixel: Array | tuple[float, float], margin_px: float = 0.0) -> bool:
        """Whether a pixel (2,) lies at least `margin_px` inside the image; False for NaN."""
        u, v = pixel
        m = margin_px - 0.5
        return bool(m <= u <= self.width - 1 - m and m <= v <= self.height - 1 - m)


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
        if joints_right is not None:
            T_root_right = self.eye_poses(joints_right)[1]
        return StereoView(View(self.left, T_root_left), View(self.right, T_root_right))

    def view_of(self, frame: StereoFrame) -> StereoView:
        """Both cameras at the stamps of the frame's images."""
        return self.view(frame.joints_left_rad, frame.joints_right_rad)
