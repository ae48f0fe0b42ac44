"""An object from the part of its rim that shows: cut off by the image's border, or half hidden.

The rim of a sphere is a circular cone of directions b around its centre's direction c: b·c = cos θ.
With n = c / cos θ that is linear, b·n = 1, so a robust least-squares fit gives both.  What lies before a round
or a convex object, the fingers that hold it, cuts notches into its outline: on the convex hull of what
shows lies only its own rim.
"""

import math
from dataclasses import replace

import cv2
import numpy as np

from pps_vision.geometry.compiled import Vector
from pps_vision.types import Array, Image, Mask
from tracking.compiled_masks import hollowness
from tracking.cones import consensus, crossings, fitted, on_sides, scale_of
from tracking.ego_motion import Box
from tracking.outline import Coverage, Optics, Outline, cover, outline

_ROUNDS = 4
_FAIR_PX = 0.3  # residuals beyond this count less
_INLIER_PX = 1.0
_FAIR_ODD_PX = 1.0  # the same, of what is no sphere
_ALIKE, _SIDES = 3.0, 8.0  # neighbouring rim points that err together; where it is no sphere, how many groups of them
_HULL_PX = 0.7  # from the hull, within which a point is on it
_FREE, _FREE_HIDDEN = 0.5, 0.4  # of the rim, least on the hull, of what has no limbs; of what is known to be hidden
_NOTCH = 0.03  # of the hull that does not show, above which something lies before it
# Least share of the rim on the hull that lies on one cone: of a ball, of one cut off by the border, of one known to be
# hidden: what hides half of it may have a straight edge, which is on the hull as well.
_OF_BALL, _OF_CUT, _OF_HIDDEN = 0.65, 0.8, 0.5
_SEEDED = 0.8  # of the points that must lie on the cone in the end, on the best through three of them
_MIN_POINTS = 12
_ANY = (math.nan, math.nan, math.nan)
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
    if not (shape.at_border or hidden or (notched and hollowness(coverage.alpha) > _NOTCH)):
        return shape
    shown = shape
    if shape.at_border or hidden:
        missing = max(1 - shape.area_px / expected, 0.3 if shape.at_border else 0.0)
        off_px = 0.5 * missing * optics.camera.focal_px * shape.angular_radius_rad
        shown = replace(shape, cov_px=shape.cov_px + off_px**2 * np.eye(2))
    whole = complete(shape, coverage, optics, expected)
    if whole is None or whole.area_px > expected / _WHOLE**2 * (2.0 if expected_area_px is None else 1.0):
        return shown
    return replace(whole, shown=shown)


def complete(shape: Outline, coverage: Coverage, optics: Optics, expected_area_px: float) -> Outline | None:
    """The outline of the sphere whose visible rim this is; None where the rim shows too little of it to tell.

    Where too little of the rim lies on one cone it is no sphere's; the cone nearest to it then stands for it, unless
    too little of the outline is on its hull: that is no convex object, or hardly any of it shows.
    """
    hidden = shape.area_px < _WHOLE * expected_area_px
    every = rim_rays(coverage, optics)
    if len(every) < _MIN_POINTS:
        return None
    rays = every[on_hull(every, optics.camera.focal_px)]
    if len(rays) < _MIN_POINTS:
        return None
    best, agreeing = consensus(rays, optics.camera.focal_px, _INLIER_PX)
    share = _OF_CUT if shape.at_border else _OF_HIDDEN if hidden else _OF_BALL
    least = max(share * len(rays), _MIN_POINTS)
    if agreeing >= _SEEDED * least and (axis := _fit(rays, best, _FAIR_PX, optics)) is not None:
        residual_px = _residual_px(rays, axis, optics)
        inlier = np.abs(residual_px) < _INLIER_PX
        if np.count_nonzero(inlier) >= least:
            return _outline(shape, axis, rays[inlier], residual_px[inlier], _ALIKE, optics)
    if shape.at_border or len(rays) < (_FREE_HIDDEN if hidden else _FREE) * len(every):
        return None
    if (axis := _fit(rays, None, _FAIR_ODD_PX, optics)) is None:
        return None
    found = _outline(shape, axis, rays, _residual_px(rays, axis, optics), len(rays) / _SIDES, optics)
    return None if found is None else replace(found, departure=shape.departure)


def _fit(rays: Array, near: Vector | None, fair_px: float, optics: Optics) -> Array | None:
    """The cone nearest to the rays, of which those farther than `fair_px` off count less, from one of about that axis,
    or from none; None where they do not tell."""
    axis = fitted(rays, near or _ANY, fair_px, optics.camera.focal_px, _ROUNDS + (near is None))
    return None if math.isnan(axis[0]) else np.array(axis)


def on_hull(rays: Array, focal_px: float) -> Mask:
    """(n,) which rim points (n, 3) lie on the convex hull of them all."""
    flat = (rays[:, :2] / rays[:, 2:] * focal_px).astype(np.float32)
    return on_sides(flat, np.ascontiguousarray(cv2.convexHull(flat)[:, 0]), _HULL_PX)


def rim_rays(coverage: Coverage, optics: Optics) -> Array:
    """(n, 3) directions where the coverage crosses ½ between neighbouring pixels; the image's border
    is no such crossing, so what it cuts off leaves no false rim."""
    return crossings(coverage.alpha, optics.camera.bearing_map, *coverage.box[:2])


def _residual_px(rays: Array, axis: Array, optics: Optics) -> Array:
    """(n,) how far each ray is from the cone b·axis = 1, as an angle, in pixels."""
    off: Array = (rays @ axis - 1) * scale_of(tuple(axis.tolist()), optics.camera.focal_px)
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
