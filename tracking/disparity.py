"""Distance from the disparity inside the object's image: the alternative to two outlines' centres.

Both images are resampled, around the object only, as seen by two parallel eyes, so that matching
runs along rows and disparity 0 is the distance the outlines suggest.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import StereoView, View
from pps_vision.geometry.se3 import move_points
from pps_vision.types import Array, Image, Observation3D
from tracking.outline import Outline


@dataclass(frozen=True)
class DisparityParams:
    """Semi-global matching (FACTS §4) over ± `reach_px` (a multiple of 8), with blocks of
    `block_px`; only where the blocks' mean detail is `min_detail` grey levels, for a smooth surface
    has no disparity of its own; that must be `min_share` of the object's middle."""

    reach_px: int = 16
    block_px: int = 7
    min_detail: float = 4.0
    min_share: float = 0.3

    def __post_init__(self) -> None:
        if self.reach_px < 8 or self.reach_px % 8 or self.block_px < 3 or self.block_px % 2 == 0:
            raise ValueError(
                f"disparity reach {self.reach_px} px, block {self.block_px} px: "
                "expected a multiple of 8 from 8 on, and an odd number from 3 on"
            )


def refine_distance(
    params: DisparityParams, view: StereoView, left: Image, right: Image, shape: Outline, seen: Observation3D
) -> Observation3D | None:
    """The observation `seen` with its distance from the left eye taken from the disparity of the
    object's surface (a sphere's, of the outline's angular radius); None where too little matches."""
    camera = view.left.camera
    reach = params.reach_px
    side = 2 * int(np.ceil(shape.angular_radius_rad * camera.focal_px)) + 4 * reach
    R_root_rect, baseline = _parallel_axes(view, seen.p_root)
    patches = [
        _patch(image, eye, R_root_rect, seen.p_root, side, camera.focal_px)
        for image, eye in ((left, view.left), (right, view.right))
    ]
    matcher = cv2.StereoSGBM.create(
        minDisparity=-reach,
        numDisparities=2 * reach,
        blockSize=params.block_px,
        P1=8 * params.block_px**2,
        P2=32 * params.block_px**2,
        uniquenessRatio=5,
    )
    disparity = np.asarray(matcher.compute(patches[0], patches[1]), dtype=float) / 16
    radius_px = 0.5 * shape.angular_radius_rad * camera.focal_px
    v, u = np.mgrid[:side, :side] - (side - 1) / 2
    middle = u * u + v * v <= radius_px**2
    good = disparity[middle & (disparity >= -reach) & (_detail(patches[0], params.block_px) > params.min_detail)]
    if len(good) < max(params.min_share * np.count_nonzero(middle), 5):
        return None
    depth_guess = float((R_root_rect.T @ (seen.p_root - view.left.center))[2])
    inverse_depth = 1 / depth_guess + float(np.median(good)) / (camera.focal_px * baseline)
    spread_px = max(1.4826 * float(np.median(np.abs(good - np.median(good)))), 0.2)
    ray = seen.p_root - view.left.center
    guess = float(np.linalg.norm(ray))
    to_surface = guess / (inverse_depth * depth_guess)
    distance = to_surface / (1 - 0.92 * np.sin(shape.angular_radius_rad))  # the middle's mean depth
    p = view.left.center + ray * (distance / guess)
    std = (
        distance * depth_guess * spread_px / (camera.focal_px * baseline) / np.sqrt(len(good) / params.block_px**2 + 1)
    )
    return replace(seen, p_root=p, cov_root=_cov(ray / guess, std, seen.cov_root))


def _parallel_axes(view: StereoView, p: Array) -> tuple[Array, float]:
    """`R_root_rect` with x along the baseline and z towards the object, and the baseline in m."""
    line = view.right.center - view.left.center
    baseline = float(np.linalg.norm(line))
    x = line / baseline
    ahead = p - 0.5 * (view.left.center + view.right.center)
    z = ahead - (ahead @ x) * x
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]), baseline


def _patch(image: Image, eye: View, R_root_rect: Array, p: Array, side: int, focal_px: float) -> NDArray[np.uint8]:
    """(side, side) grey image around `p`, which lies in its middle, for an eye turned to `R_root_rect`."""
    x, y, z = R_root_rect.T @ (p - eye.center)
    v, u = (np.mgrid[:side, :side] - (side - 1) / 2) / focal_px
    points = np.stack([u + x / z, v + y / z, np.ones_like(u)], axis=-1) @ R_root_rect.T + eye.center
    at = eye.camera.project(move_points(eye.T_camera_root, points))
    map_u, map_v = np.nan_to_num(at, nan=-1.0).astype(np.float32).transpose(2, 0, 1)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.remap(grey, map_u, map_v, cv2.INTER_LINEAR), dtype=np.uint8)


def _detail(patch: NDArray[np.uint8], block_px: int) -> Array:
    """(h, w) mean size of what is finer than a block, grey levels."""
    fine = cv2.absdiff(patch, cv2.GaussianBlur(patch, (0, 0), block_px / 3)).astype(np.float32)
    return np.asarray(cv2.blur(fine, (block_px, block_px)), dtype=float)


def _cov(ray: Array, std_m: float, cov: Array) -> Array:
    """`cov` (3, 3) with the variance along a ray replaced."""
    across = np.eye(3) - np.outer(ray, ray)
    new: Array = across @ cov @ across + std_m**2 * np.outer(ray, ray)
    return new
