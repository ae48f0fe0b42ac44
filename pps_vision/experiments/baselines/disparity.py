"""Baselines of the stereo stage: other triangulations of two pixels, and disparity maps of the whole image."""

from collections.abc import Callable

import cv2
import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import rectified
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import midpoint as rays_midpoint
from pps_vision.types import Array, StereoFrame

RANGE_PX = 96  # disparities that are searched: at 0.2 m an iCub's rectified eyes have 91
_NEARER = 0.92  # of its radius: how much nearer than its centre the middle of a ball's visible surface is


def midpoint(view: StereoView, left_px: Array, right_px: Array) -> Array | None:
    """Return the middle (3,) of the shortest way between the two rays."""
    return rays_midpoint(view.left.center, view.left.rays(left_px), view.right.center, view.right.rays(right_px))


def linear(view: StereoView, left_px: Array, right_px: Array) -> Array | None:
    """Return OpenCV's direct linear transformation (3,)."""
    normalised = []
    for camera, px in ((view.left.camera, left_px), (view.right.camera, right_px)):
        point = cv2.undistortPoints(np.asarray(px).reshape(1, 1, 2), camera.K, np.array(camera.distortion))
        normalised.append(np.asarray(point, dtype=float).reshape(2, 1))
    projections = view.left.T_camera_root[:3], view.right.T_camera_root[:3]
    homogeneous = cv2.triangulatePoints(*projections, *normalised)[:, 0]
    return np.asarray(homogeneous[:3] / homogeneous[3])


def block_matching() -> cv2.StereoMatcher:
    """Return OpenCV's block matching."""
    return cv2.StereoBM.create(RANGE_PX, 15)


def semi_global() -> cv2.StereoMatcher:
    """Return OpenCV's semi-global matching."""
    return cv2.StereoSGBM.create(0, RANGE_PX, 5, P1=8 * 25, P2=32 * 25, uniquenessRatio=5)


def in_whole_image(
    make: Callable[[], cv2.StereoMatcher], frame: StereoFrame, view: StereoView, p: Array, radius_m: float
) -> Array | None:
    """Return a ball's centre (3,) from the median disparity of its middle in a map of the whole image.

    The ball's direction, taken from its true place `p` (3,), replaces an image tracker's.
    """
    left, right, R_root_rect, Q = rectified(view, frame)
    grey = [
        cv2.copyMakeBorder(cv2.cvtColor(i, cv2.COLOR_RGB2GRAY), 0, 0, RANGE_PX, 0, cv2.BORDER_REPLICATE)
        for i in (left, right)
    ]
    disparity = np.asarray(make().compute(*grey), dtype=float)[:, RANGE_PX:] / 16
    focal, baseline = Q[2, 3], float(np.linalg.norm(view.right.center - view.left.center))
    toward = R_root_rect.T @ (p - view.left.center)
    distance = float(np.linalg.norm(toward))
    u, v = focal * toward[:2] / toward[2] - Q[:2, 3]
    rows, columns = np.mgrid[: disparity.shape[0], : disparity.shape[1]]
    middle = (columns - u) ** 2 + (rows - v) ** 2 <= (0.5 * radius_m / distance * focal) ** 2
    good = disparity[middle & (disparity > 0)]
    if len(good) < max(0.3 * np.count_nonzero(middle), 5):
        return None
    depth = focal * baseline / float(np.median(good))
    center: Array = view.left.center + (p - view.left.center) * depth / toward[2] / (1 - _NEARER * radius_m / distance)
    return center
