"""An object from the part of its rim that shows: cut off by the image's border, or half hidden.

The rim of a sphere is a circular cone of directions b around its centre's direction c: b·c = cos θ.
With n = c / cos θ that is linear, b·n = 1, so a robust least-squares fit gives both.  What lies before a round
or a convex object, the fingers that hold it, cuts notches into its outline: on the convex hull of what
shows lies only its own rim.
"""

from dataclasses import replace

import cv2
import numpy as np

from pps_vision.types import Array, Image, Mask
from tracking.ego_motion import Box
from tracking.outline import Coverage, Optics, Outline, cover, outline

_ROUNDS = 4
_FAIR_PX = 0.3  # residuals beyond this count less
_INLIER_PX = 1.0
_FAIR_ODD_PX = 1.0  # the same, of what is no sphere
_ALIKE, _SIDES = 3.0, 8.0  # neighbouring rim points that err together; where it is no sphere, how many groups of them
_HULL_PX = 0.7  # from the hull, within which a point is on it
_LEAST_FREE = 0.4  # of the rim, on the hull
_SEEDED = 0.8  # of the points that must lie on the cone in the end, on the best through three of them
_MIN_POINTS = 12
_WHOLE = 0.85  # of the expected area, above which nothing is hidden


def see(
    image: Image,
    mask: Mask,
    box: Box,
    optics: Optics,
    expected_area_px: float | None = None,
    notched: bool = True,
) -> Outline | None:
    """The outline of what a hard mask (h, w) of the region `box` shows of an object.

    What is cut off or, given its expected area, partly hidden is completed to a sphere where the rim
    allows; where not, the covariance says how far the middle of the visible part may be off.  `notched`: so is
    what is no disc though all of its area shows, by the rim on its hull.
    """
    coverage = cover(image, mask, box)
    shape = outline(coverage, optics)
    if shape is None:
        return None
    expected = expected_area_px or shape.area_px
    hidden = shape.area_px < _WHOLE * expected
    if not (shape.at_border or hidden or (notched and shape.oddness > 0)):
        return shape
    whole = complete(shape, coverage, optics, 0.8 if shape.at_border else 0.5 if hidden else 0.65)
    if whole is not None and whole.area_px < expected / _WHOLE**2 * (2.0 if expected_area_px is None else 1.0):
        return whole
    if not (shape.at_border or hidden):
        return shape
    missing = max(1 - shape.area_px / expected, 0.3 if shape.at_border else 0.0)
    off_px = 0.5 * missing * optics.camera.focal_px * shape.angular_radius_rad
    return replace(shape, cov_px=shape.cov_px + off_px**2 * np.eye(2))


def complete(shape: Outline, coverage: Coverage, optics: Optics, min_share: float) -> Outline | None:
    """The outline of the sphere whose visible rim this is; None where the rim shows too little of it to tell.

    Where less than `min_share` of the rim lies on one cone it is no sphere's; the cone nearest to it then stands for
    it, unless most of the outline is notched: that is no convex object, or hardly any of it shows.
    """
    every = rim_rays(coverage, optics)
    if len(every) < _MIN_POINTS:
        return None
    rays = every[on_hull(every, optics.camera.focal_px)]
    if len(rays) < _MIN_POINTS:
        return None
    best, agreeing = _consensus(rays, optics)
    least = max(min_share * len(rays), _MIN_POINTS)
    if agreeing >= _SEEDED * least and (axis := _fit(rays, best, _FAIR_PX, optics)) is not None:
        residual_px = _residual_px(rays, axis, optics)
        inlier = np.abs(residual_px) < _INLIER_PX
        if np.count_nonzero(inlier) >= least:
            return _outline(shape, axis, rays[inlier], residual_px[inlier], _ALIKE, optics)
    if shape.at_border or len(rays) < _LEAST_FREE * len(every):
        return None
    nearest = np.linalg.lstsq(rays, np.ones(len(rays)))[0]
    if (axis := _fit(rays, nearest, _FAIR_ODD_PX, optics)) is None:
        return None
    found = _outline(shape, axis, rays, _residual_px(rays, axis, optics), len(rays) / _SIDES, optics)
    return None if found is None else replace(found, departure=shape.departure)


def _fit(rays: Array, axis: Array, fair_px: float, optics: Optics) -> Array | None:
    """The cone nearest to the rays, of which those farther than `fair_px` off count less, starting from one of about
    this `axis`; None where they do not tell."""
    for _ in range(_ROUNDS):
        off = np.maximum(np.abs(_residual_px(rays, axis, optics)), fair_px)
        weighted = rays / (off * off)[:, None]
        normal = weighted.T @ rays
        try:
            axis = np.linalg.solve(normal, weighted.sum(axis=0))
        except np.linalg.LinAlgError:
            return None
    return axis if np.linalg.cond(normal) < 1e10 and axis @ rays[0] > 0 else None


def on_hull(rays: Array, focal_px: float) -> Mask:
    """(n,) which rim points (n, 3) lie on the convex hull of them all."""
    flat = (rays[:, :2] / rays[:, 2:] * focal_px).astype(np.float32)
    corners = cv2.convexHull(flat)[:, 0]
    sides = np.roll(corners, -1, axis=0) - corners
    corners, sides = corners[sides.any(axis=1)], sides[sides.any(axis=1)]
    across = np.stack([sides[:, 1], -sides[:, 0]]) / np.hypot(*sides.T)
    depth = np.abs(flat @ across - np.vecdot(corners, across.T))
    on: Mask = depth.min(axis=1) < _HULL_PX
    return on


def rim_rays(coverage: Coverage, optics: Optics) -> Array:
    """(n, 3) directions where the coverage crosses ½ between neighbouring pixels; the image's border
    is no such crossing, so what it cuts off leaves no false rim."""
    x0, y0, _, _ = coverage.box
    inside = coverage.alpha > 0.5
    beside, below = np.nonzero(inside[:, :-1] != inside[:, 1:]), np.nonzero(inside[:-1] != inside[1:])
    rows, columns = (np.concatenate(pair) for pair in zip(beside, below, strict=True))
    next_rows, next_columns = rows.copy(), columns.copy()
    next_rows[len(beside[0]) :] += 1
    next_columns[: len(beside[0])] += 1
    level, next_level = coverage.alpha[rows, columns], coverage.alpha[next_rows, next_columns]
    t = ((0.5 - level) / (next_level - level)).astype(float)[:, None]
    bearings = optics.camera.bearing_map
    p, q = bearings[y0 + rows, x0 + columns], bearings[y0 + next_rows, x0 + next_columns]
    rays = p + t * (q - p)
    unit: Array = rays / np.sqrt(np.vecdot(rays, rays))[:, None]
    return unit


def _consensus(rays: Array, optics: Optics) -> tuple[Array, int]:
    """The cone through three rim points, an arc apart, that most other rim points agree with, and how many do."""
    middle = rays.mean(axis=0)
    apart = rays - middle
    across = np.linalg.eigh(apart.T @ apart)[1][:, :0:-1]
    around = rays[np.argsort(np.arctan2(*(apart @ across).T))]
    n = len(around)
    start = np.repeat(np.arange(0, n, max(n // 24, 1)), 2)
    arc = np.where(np.arange(len(start)) % 2, n // 8, n // 5)
    triples = around[(start[:, None] + arc[:, None] * np.arange(3)) % n]
    proper = np.abs(np.linalg.det(triples)) > 1e-12
    if not proper.any():
        return middle, 0
    cones = np.linalg.solve(triples[proper], np.ones((int(proper.sum()), 3, 1)))[..., 0]
    agreeing = np.count_nonzero(np.abs(_residual_px(rays, cones, optics)) < _INLIER_PX, axis=0)
    best = int(agreeing.argmax())
    return cones[best], int(agreeing[best])


def _residual_px(rays: Array, axis: Array, optics: Optics) -> Array:
    """(n,) or (n, k) how far each ray is from the cone b·axis = 1, or from k of them, as an angle, in pixels."""
    length2 = np.maximum(np.vecdot(axis, axis), 1 + 1e-9)
    off: Array = (rays @ axis.T - 1) * (optics.camera.focal_px / np.sqrt(length2 - 1))
    return off


def _outline(
    shape: Outline, axis: Array, rays: Array, residual_px: Array, alike: float, optics: Optics
) -> Outline | None:
    """The cone as an outline, with the covariance of the fit; `alike` neighbouring rim points err together."""
    length = float(np.linalg.norm(axis))
    if length <= 1:
        return None
    theta = float(np.arccos(1 / length))
    sigma = max(float(np.sqrt(np.mean(residual_px**2))), 0.05) / optics.camera.focal_px * np.tan(theta)
    cov_axis = alike * sigma**2 * np.linalg.inv(rays.T @ rays)
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
