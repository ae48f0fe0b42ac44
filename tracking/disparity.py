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


@dataclass(frozen=True)
class DisparityParams:
    """Semi-global matching (FACTS §4) over ± `reach_px` (a multiple of 8), with blocks of
    `block_px`; only where the blocks' mean detail is `min_detail` grey levels, for a smooth surface
    has no disparity of its own; that must be `min_share` of the object's middle."""

    reach_px: int = 8
    block_px: int = 7
    min_detail: float = 4.0
    min_share: float = 0.3

    def __post_init__(self) -> None:
        if self.reach_px < 8 or self.reach_px % 8 or self.block_px < 3 or self.block_px % 2 == 0:
            raise ValueError(
                f"disparity reach {self.reach_px} px, block {self.block_px} px: "
                "expected a multiple of 8 from 8 on, and an odd number from 3 on"
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
    half = int(np.ceil(radius_px)) + params.block_px
    patches = parallel_patches(view, left, right, surface, (half + 2 * params.reach_px, half))
    disparity = match(params, patches.left, patches.right)
    v, u = np.mgrid[-half : half + 1, -half - 2 * params.reach_px : half + 2 * params.reach_px + 1]
    middle = u * u + v * v <= radius_px**2
    good = disparity[middle & np.isfinite(disparity)]
    if len(good) < max(params.min_share * np.count_nonzero(middle), 5):
        return None
    per_px = patches.depth_m / (patches.focal_px * patches.baseline_m)  # how much nearer a pixel of disparity is
    spread_px = max(1.4826 * float(np.median(np.abs(good - np.median(good)))), 0.2)
    guess = float(np.linalg.norm(ray))
    distance = guess / (1 + per_px * float(np.median(good)))
    error_px = float(np.hypot(spread_px / np.sqrt(len(good) / params.block_px**2 + 1), _COMMON_PX))
    std = distance * float(np.hypot(per_px * error_px, _NEARER_STD * np.sin(shape.angular_radius_rad)))
    p = view.left.center + ray * (distance / guess)
    return replace(seen, p_root=p, cov_root=_cov(ray / guess, std, seen.cov_root))


def match(params: DisparityParams, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Array:
    """(h, w) disparity in px of two grey images (h, w) whose rows match; NaN where there is none, or
    too little detail to trust one."""
    matcher = cv2.StereoSGBM.create(
        minDisparity=-params.reach_px,
        numDisparities=2 * params.reach_px,
        blockSize=params.block_px,
        P1=8 * params.block_px**2,
        P2=32 * params.block_px**2,
        uniquenessRatio=5,
    )
    disparity = np.asarray(matcher.compute(left, right), dtype=float) / 16
    good = (disparity >= -params.reach_px) & (_detail(left, params.block_px) > params.min_detail)
    return np.where(good, disparity, np.nan)


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


def _detail(patch: NDArray[np.uint8], block_px: int) -> Array:
    """(h, w) mean size of what is finer than a block, grey levels."""
    fine = cv2.absdiff(patch, cv2.GaussianBlur(patch, (0, 0), block_px / 3)).astype(np.float32)
    return np.asarray(cv2.blur(fine, (block_px, block_px)), dtype=float)


def _cov(ray: Array, std_m: float, cov: Array) -> Array:
    """`cov` (3, 3) with the variance along a ray replaced."""
    across = np.eye(3) - np.outer(ray, ray)
    new: Array = across @ cov @ across + std_m**2 * np.outer(ray, ray)
    return new
