"""Where two eyes' image points meet, and how well that is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array


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
    if denominator < 1e-10:
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
    point in front of both eyes explains them.  Gauss–Newton from the midpoint of the rays.
    """
    measured = ((view.left, np.asarray(left_px, dtype=float)), (view.right, np.asarray(right_px, dtype=float)))
    weights: list[Array] = [np.linalg.inv(np.asarray(cov, dtype=float)) for cov in (cov_left_px, cov_right_px)]
    rays = [v.rays(px) for v, px in measured]
    p = midpoint(view.left.center, rays[0], view.right.center, rays[1])
    if p is None:
        return None
    for _ in range(10):
        step, information = _gauss_newton(p, measured, weights)
        if step is None:
            return None
        p = p + step
        if step @ step < 1e-14 * (p @ p):  # converges quadratically: the next step would be nothing
            break
    errors = [px - v.project(p) for v, px in measured]
    if not np.all(np.isfinite(errors)):
        return None
    chi2 = sum(float(e @ w @ e) for e, w in zip(errors, weights, strict=True))
    cov_root: Array = np.linalg.inv(information)
    return Triangulation(p, cov_root, float(np.sqrt(np.mean(np.square(errors)))), chi2)


def _gauss_newton(
    p: Array, measured: tuple[tuple[View, Array], ...], weights: list[Array]
) -> tuple[Array | None, Array]:
    """One step towards the most likely point and the information matrix there."""
    information, pull = np.zeros((3, 3)), np.zeros(3)
    for (view, px), weight in zip(measured, weights, strict=True):
        J = view.project_jacobian(p)
        information += J.T @ weight @ J
        pull += J.T @ weight @ (px - view.project(p))
    if not np.all(np.isfinite(pull)) or np.linalg.cond(information) > 1e14:
        return None, information
    step: Array = np.linalg.solve(information, pull)
    return step, information
