"""Distance from the disparity inside the object's image: the alternative to two outlines' centres.

Both images are resampled, around the object only, as seen by two parallel eyes, so that matching
runs along rows and disparity 0 is the distance the outlines suggest.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array, Image, Observation3D
from tracking.outline import Outline

_NEARER = 0.92  # of its radius: how much nearer than its centre the middle of a ball's surface is on the mean…
_NEARER_STD = 0.04  # …and by how much that depends on where in the middle the texture happens to be
_COMMON_PX = 0.1  # error that all pixels of a match share
_CORRELATION = 4.0  # neighbouring pixels err together: this many are worth one
_FINE_PX = 2.0  # detail is what is smaller than this


@dataclass(frozen=True)
class DisparityParams:
    """The middle half of the object is correlated over ± `reach_px` of its row.  No answer where that
    half's radius is below `min_radius_px` or its detail below `min_detail` grey levels (standard deviation;
    a smooth surface has no disparity of its own), nor for a correlation below `min_score`."""

    reach_px: int = 8
    min_radius_px: float = 4.0
    min_detail: float = 2.4
    min_score: float = 0.7

    def __post_init__(self) -> None:
        if self.reach_px < 2 or self.min_radius_px < 2 or not 0 < self.min_score < 1:
            raise ValueError(
                f"disparity reach {self.reach_px} px, least radius {self.min_radius_px} px, least score "
                f"{self.min_score}: expected at least 2 px of both, and a score in (0, 1)"
            )


@dataclass(frozen=True)
class Patches:
    """Grey images (h, w) around one point as two parallel eyes would see it, that look across their
    baseline: the point is in the middle of both, so disparity 0 is its `depth_m`."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth_m: float
    focal_px: float
    baseline_m: float


def refine_distance(
    params: DisparityParams, view: StereoView, left: Image, right: Image, shape: Outline, seen: Observation3D
) -> Observation3D | None:
    """The observation `seen` with its distance from the left eye taken from the disparity of the
    object's surface (a sphere's, of the outline's angular radius); None where too little matches."""
    ray = seen.p_root - view.left.center
    surface = view.left.center + ray * (1 - _NEARER * np.sin(shape.angular_radius_rad))
    radius_px = 0.5 * shape.angular_radius_rad * view.left.camera.focal_px
    half = int(radius_px + 2 * _FINE_PX)
    patches = parallel_patches(view, left, right, surface, (half + params.reach_px, half))
    found = match(params, patches.left, patches.right, radius_px)
    if found is None:
        return None
    disparity, error_px = found
    per_px = patches.depth_m / (patches.focal_px * patches.baseline_m)  # how much nearer a pixel of disparity is
    if not per_px * disparity > -0.5:
        return None
    guess = float(np.linalg.norm(ray))
    distance = guess / (1 + per_px * disparity)
    std = distance * float(np.hypot(per_px * error_px, _NEARER_STD * np.sin(shape.angular_radius_rad)))
    p = view.left.center + ray * (distance / guess)
    return replace(seen, p_root=p, cov_root=_cov(ray / guess, std, seen.cov_root))


def match(
    params: DisparityParams, left: NDArray[np.uint8], right: NDArray[np.uint8], radius_px: float
) -> tuple[float, float] | None:
    """Disparity (px) of what is within `radius_px` of the middle of two grey images (h, w) whose rows match,
    and its standard deviation; None where nothing there tells it."""
    r, (cy, cx) = int(radius_px), (np.array(left.shape) - 1) // 2
    reach = params.reach_px
    middle = np.s_[cy - r : cy + r + 1, cx - r : cx + r + 1]
    patch = left[middle]
    if radius_px < params.min_radius_px or float(_detail(left)[middle].std()) < params.min_detail:
        return None
    strip = right[cy - r : cy + r + 1, cx - r - reach : cx + r + reach + 1]
    score = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)[0]
    k = int(np.argmax(score))
    if not (0 < k < len(score) - 1 and score[k] > params.min_score):
        return None
    a, b, c = (float(value) for value in score[k - 1 : k + 2])
    curvature = max(2 * b - a - c, 1e-6)  # of the parabola through the best three: what texture there is…
    noise = max(1 - b, 0.0)  # …and what it does not explain
    std = np.hypot(np.sqrt(2 * _CORRELATION * noise / (patch.size * curvature)), _COMMON_PX)
    return reach - k - 0.5 * (c - a) / curvature, float(std)


def parallel_patches(view: StereoView, left: Image, right: Image, p_root: Array, half_size: tuple[int, int]) -> Patches:
    """Both RGB images to `half_size` (across, down) px around a point (3,), from eyes that are turned parallel."""
    line = view.right.center - view.left.center
    baseline = float(np.linalg.norm(line))
    x = line / baseline
    ahead = p_root - 0.5 * (view.left.center + view.right.center)
    z = ahead - (ahead @ x) * x
    z /= np.linalg.norm(z)
    R_root_rect = np.column_stack([x, np.cross(z, x), z])
    focal_px = view.left.camera.focal_px
    found = [
        _patch(i, eye, R_root_rect, p_root, half_size, focal_px) for i, eye in ((left, view.left), (right, view.right))
    ]
    depth = float((p_root - view.left.center) @ z)
    return Patches(found[0], found[1], depth, focal_px, baseline)


def _patch(
    image: Image, eye: View, R_root_rect: Array, p: Array, half_size: tuple[int, int], focal_px: float
) -> NDArray[np.uint8]:
    """Grey image around `p`, which lies in its middle, for an eye turned to `R_root_rect`."""
    x, y, z = R_root_rect.T @ (p - eye.center)
    across, down = half_size
    K = np.array([[focal_px, 0, across - focal_px * x / z], [0, focal_px, down - focal_px * y / z], [0, 0, 1]])
    R_rect_eye = R_root_rect.T @ eye.T_root_camera[:3, :3]
    distortion = np.array(eye.camera.distortion)
    maps = cv2.initUndistortRectifyMap(
        eye.camera.K, distortion, R_rect_eye, K, (2 * across + 1, 2 * down + 1), cv2.CV_16SC2
    )
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.remap(grey, *maps, cv2.INTER_LINEAR), dtype=np.uint8)


def _detail(patch: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w) what is fine, grey levels."""
    grey = patch.astype(np.float32)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), _FINE_PX), np.float32)


def _cov(ray: Array, std_m: float, cov: Array) -> Array:
    """`cov` (3, 3) with the variance along a ray replaced."""
    across = np.eye(3) - np.outer(ray, ray)
    new: Array = across @ cov @ across + std_m**2 * np.outer(ray, ray)
    return new
