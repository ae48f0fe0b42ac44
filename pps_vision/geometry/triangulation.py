"""Triangulation of two image points, with its covariance."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.camera import StereoView, View
from pps_vision.geometry.compiled import PARALLEL, Sighting, triangulated
from pps_vision.types import Array


class Triangulation(NamedTuple):
    """`p_root` (3,) m, `cov_root` (3, 3) m² (the Cramér–Rao bound for the given pixel noise),
    `residual_px` the RMS reprojection error over the four image coordinates, and
    `mahalanobis` its size in units of the pixel noise (χ² with one degree of freedom)."""

    p_root: Array
    cov_root: Array
    residual_px: float
    mahalanobis: float


def midpoint(center_a: Array, ray_a: Array, center_b: Array, ray_b: Array) -> Array | None:
    """Middle of the shortest segment between two rays (3,); None if it is behind a centre or the rays are parallel."""
    gap = center_b - center_a
    cosine = float(ray_a @ ray_b)
    denominator = 1 - cosine**2
    if denominator < PARALLEL:
        return None
    along_a = (gap @ ray_a - cosine * (gap @ ray_b)) / denominator
    along_b = (cosine * (gap @ ray_a) - gap @ ray_b) / denominator
    if along_a <= 0 or along_b <= 0:
        return None
    return 0.5 * (center_a + along_a * ray_a + center_b + along_b * ray_b)


def triangulate(
    view: StereoView,
    left_px: ArrayLike,
    right_px: ArrayLike,
    cov_left_px: ArrayLike,
    cov_right_px: ArrayLike,
    more_px2: float = 0.0,
) -> Triangulation | None:
    """The point whose images are most likely the measured ones (Gaussian pixel noise; Kanatani's optimal correction).

    Pixels (2,) are as recorded, distortion included; covariances (2, 2) px², to which `more_px2` comes in each
    coordinate.  None where no point in front of both eyes explains them.

    Raises:
        ValueError: A covariance is not finite or not positive definite.
    """
    left = _measured(view.left, left_px, cov_left_px, more_px2)
    right = _measured(view.right, right_px, cov_right_px, more_px2)
    rays_meet, p_root, (xx, xy, xz, yy, yz, zz), moved2_px2, chi2 = triangulated(left, right)
    if not rays_meet:
        return None
    cov_root = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return Triangulation(np.array(p_root), cov_root, 0.5 * moved2_px2**0.5, chi2)


def _measured(eye: View, pixel: ArrayLike, cov: ArrayLike, more_px2: float) -> Sighting:
    """The measurement of one camera, as the compiled function takes it."""
    u, v = np.asarray(pixel, dtype=float).tolist()
    (uu, uv), (_, vv) = np.asarray(cov, dtype=float).tolist()
    uu += more_px2
    vv += more_px2
    if not (0 < uu < math.inf and vv < math.inf and uv * uv < uu * vv):
        raise ValueError(f"pixel covariance [[{uu}, {uv}], [{uv}, {vv}]]; expected a positive definite one")
    return eye.pose, eye.camera.numbers, u, v, uu, uv, vv
