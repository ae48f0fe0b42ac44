"""A round object from the part of its rim that shows: cut off by the image's border, or half hidden.

The rim of a sphere is a circular cone of directions b around its centre's direction c: b·c = cos θ.
With n = c / cos θ that is linear, b·n = 1, so a robust least-squares fit gives both.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, Image, Mask
from tracking.ego_motion import Box
from tracking.outline import Coverage, Optics, Outline, cover, outline

_ROUNDS = 6
_FAIR_PX = 0.3  # residuals beyond this count less
_INLIER_PX = 1.0
_MIN_POINTS = 12
_WHOLE = 0.85  # of the expected area, above which nothing is hidden


def see(image: Image, mask: Mask, box: Box, optics: Optics, expected_area_px: float | None = None) -> Outline | None:
    """The outline of what a hard mask (h, w) of the region `box` shows of an object.

    What is cut off or, given its expected area, partly hidden is completed to a sphere where the rim
    allows; where not, the covariance says how far the middle of the visible part may be off.
    """
    coverage = cover(image, mask, box)
    shape = outline(coverage, optics)
    if shape is None:
        return None
    expected = expected_area_px or shape.area_px
    hidden = shape.area_px < _WHOLE * expected
    if not (shape.at_border or hidden):
        return shape
    whole = complete(shape, coverage, optics, 0.8 if shape.at_border else 0.5)
    if whole is not None and whole.area_px < expected / _WHOLE**2 * (2.0 if expected_area_px is None else 1.0):
        return whole
    missing = max(1 - shape.area_px / expected, 0.3 if shape.at_border else 0.0)
    off_px = 0.5 * missing * optics.camera.focal_px * shape.angular_radius_rad
    return replace(shape, cov_px=shape.cov_px + off_px**2 * np.eye(2))


def complete(shape: Outline, coverage: Coverage, optics: Optics, min_share: float) -> Outline | None:
    """The outline of the sphere whose visible rim this is; None where less than `min_share` of the
    rim lies on one cone, or the rim shows too little of it to tell."""
    rays = rim_rays(coverage, optics)
    if len(rays) < _MIN_POINTS:
        return None
    axis = _consensus(rays, optics)
    for _ in range(_ROUNDS):
        residual_px = _residual_px(rays, axis, optics)
        weights = 1 / np.maximum(np.abs(residual_px) / _FAIR_PX, 1) ** 2
        normal = (rays * weights[:, None]).T @ rays
        if np.linalg.cond(normal) > 1e10:
            return None
        axis = np.linalg.solve(normal, (rays * weights[:, None]).sum(axis=0))
    residual_px = _residual_px(rays, axis, optics)
    inlier = np.abs(residual_px) < _INLIER_PX
    if np.count_nonzero(inlier) < max(min_share * len(rays), _MIN_POINTS) or axis @ rays[0] <= 0:
        return None
    return _outline(shape, axis, rays[inlier], residual_px[inlier], optics)


def rim_rays(coverage: Coverage, optics: Optics) -> Array:
    """(n, 3) directions where the coverage crosses ½ between neighbouring pixels; the image's border
    is no such crossing, so what it cuts off leaves no false rim."""
    x0, y0, x1, y1 = coverage.box
    bearings = optics.camera.bearing_map[y0:y1, x0:x1]
    alpha = coverage.alpha
    found = []
    for a, b, p, q in (
        (alpha[:, :-1], alpha[:, 1:], bearings[:, :-1], bearings[:, 1:]),
        (alpha[:-1], alpha[1:], bearings[:-1], bearings[1:]),
    ):
        at = (a > 0.5) != (b > 0.5)
        t: NDArray[np.float64] = ((0.5 - a[at]) / (b[at] - a[at])).astype(float)[:, None]
        found.append(p[at] + t * (q[at] - p[at]))
    rays = np.concatenate(found)
    unit: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _consensus(rays: Array, optics: Optics) -> Array:
    """The cone through three rim points, an arc apart, that most other rim points agree with."""
    middle = rays.mean(axis=0)
    across = np.linalg.svd(rays - middle, full_matrices=False)[2][:2]
    around = rays[np.argsort(np.arctan2(*((rays - middle) @ across.T).T))]
    n = len(around)
    start = np.repeat(np.arange(0, n, max(n // 24, 1)), 2)
    arc = np.where(np.arange(len(start)) % 2, n // 8, n // 5)
    triples = around[(start[:, None] + arc[:, None] * np.arange(3)) % n]
    proper = np.abs(np.linalg.det(triples)) > 1e-12
    if not proper.any():
        return middle
    cones = np.linalg.solve(triples[proper], np.ones((int(proper.sum()), 3, 1)))[..., 0]
    agreeing = [np.count_nonzero(np.abs(_residual_px(rays, cone, optics)) < _INLIER_PX) for cone in cones]
    best: Array = cones[int(np.argmax(agreeing))]
    return best


def _residual_px(rays: Array, axis: Array, optics: Optics) -> Array:
    """How far each ray is from the cone b·axis = 1, as an angle, in pixels."""
    cosine = 1 / max(float(np.linalg.norm(axis)), 1 + 1e-9)
    off: Array = (rays @ axis - 1) * cosine / np.sqrt(1 - cosine**2) * optics.camera.focal_px
    return off


def _outline(shape: Outline, axis: Array, rays: Array, residual_px: Array, optics: Optics) -> Outline | None:
    """The cone as an outline, with the covariance of the fit (neighbouring rim points err together)."""
    length = float(np.linalg.norm(axis))
    if length <= 1:
        return None
    theta = float(np.arccos(1 / length))
    sigma = max(float(np.sqrt(np.mean(residual_px**2))), 0.05) / optics.camera.focal_px * np.tan(theta)
    cov_axis = 3 * sigma**2 * np.linalg.inv(rays.T @ rays)
    camera = optics.camera
    center = camera.project(axis)
    if not np.all(np.isfinite(center)):
        return None
    J = camera.project_jacobian(axis)
    d_theta = axis / (length**2 * np.sqrt(length**2 - 1))
    cov_px = J @ cov_axis @ J.T
    side = theta * camera.focal_px
    if np.sqrt(np.trace(cov_px)) > side:
        return None
    column, row = np.clip(np.rint(center).astype(int), 0, (camera.width - 1, camera.height - 1))
    area = 2 * np.pi * (1 - 1 / length) / float(optics.solid_angle[row, column])
    return replace(
        shape,
        center_px=center,
        cov_px=cov_px + 0.03**2 * np.eye(2),
        angular_radius_rad=theta,
        angular_radius_var=float(d_theta @ cov_axis @ d_theta),
        area_px=area,
        departure=0.0,
    )
