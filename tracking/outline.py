"""Sub-pixel outline of an object: the share of every pixel that it covers, and from it centre and angular radius.

A sphere's image is the cone of directions around its centre.  So the mean viewing direction of its pixels, each
weighted by the solid angle it covers, is the direction of its centre, and the solid angle 2π(1 − cos θ) gives its
angular radius θ.  Neither perspective nor lens distortion biases them.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera
from pps_vision.geometry.compiled import Vector
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask
from tracking.ego_motion import Box
from tracking.kernels import Upper, covered, harmonics, moments

EDGE_ERROR_PX = 0.065
"""Systematic error of an edge's position (shading, background), correlated along the edge: an outline of radius r px
has a centre error of EDGE_ERROR_PX / √r and a radius error of EDGE_ERROR_PX, px.  Measured on ray-cast balls of 5 to 30
px radius, lit from above, across the light (tests/tracking/test_outline.py)."""
_BAND_PX = 2  # to both sides of a hard mask's edge, in which a pixel may be partly covered
_SMALL_PX = 60  # area up to which the band is half as wide
_CORRELATION = 2.0  # neighbouring pixels share their error: two are worth one
_WHOLE = 0.85  # share of the expected area below which part of the object is hidden
_OFF_CENTER = 4 / (3 * math.pi) / 0.5 / math.sqrt(2)  # half a disc's centroid is 4/(3π) of its radius off; per axis
_SIZE_ERROR = 0.03  # from one frame to the next an object's size is predicted this well
_EDGE_PX = 0.3  # standard deviation of a mask's edge
_LEAST_VISIBLE, _LEAST_EDGE_PX, _ON_DISC = 0.25, 12, 0.5  # shares of a disc's area and of the edge that lies on it
_ROUND = 1.12  # ratio of a disc's sides, and of its area to that of its box's ellipse
_HIDDEN_AT_BORDER = 0.3  # share of an object that is taken to be hidden where it meets the image's border


@dataclass(frozen=True)
class Coverage:
    """`alpha` (h, w) share of each pixel in `box` of the image that the object covers, and its `variance` (h, w), 0
    where the share is certain."""

    alpha: NDArray[np.float32]
    variance: NDArray[np.float32]
    box: Box


@dataclass(frozen=True)
class Outline:
    """An object's outline in one image.

    `center_px` (2,) with covariance `cov_px` (2, 2); angular radius with variance, rad and rad²; bounding box (x, y,
    width, height) px; area px; whether a part of the object is cut off by the image's border or hidden; the edge's
    second and third harmonic (cosine, sine, cosine, sine) as shares of the radius, and the share by which the second
    moment exceeds a disc's.
    """

    center_px: Array
    cov_px: Array
    angular_radius_rad: float
    angular_radius_var: float
    box_px: tuple[float, float, float, float]
    area_px: float
    is_partial: bool
    harmonics: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    non_circularity: float = 0.0

    @property
    def is_disc(self) -> bool:
        """Whether its box is as wide as high, and filled like a disc's."""
        _, _, w, h = self.box_px
        return max(w, h) < _ROUND * min(w, h) and 1 / _ROUND < self.area_px / (math.pi / 4 * w * h) < _ROUND


class Optics:
    """Per-pixel weights of one camera: solid angle, and solid angle times viewing direction."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        directions = np.concatenate([camera.bearing_map, np.ones((camera.height, camera.width, 1))], axis=-1)
        by_pixel = np.moveaxis(directions * camera.solid_angle_map[..., None], -1, 0)
        self.weights: NDArray[np.float32] = np.ascontiguousarray(by_pixel, np.float32)
        """(4, h, w) solid angle times viewing direction, and solid angle, sr."""


def fit_outline(
    image: Image,
    mask: Mask,
    box: Box,
    optics: Optics,
    expected_area_px: float | None = None,
    joined: Mask | None = None,
) -> Outline | None:
    """The outline of a hard mask (h, w) of the region `box` of an RGB image; None where nothing is covered.

    Where the image's border cuts the object off, or where less than the expected area shows that is no disc, most of
    the visible edge may lie on a disc of the expected area: that is the outline then.  Else the covariance grows by the
    distance that the centre of the visible part may be off the object's.  A mask that was cut out of a larger one,
    `joined` (h, w), shows the disc by the edge that both have in common, or nothing.
    """
    shape = outline(cover(image, mask, box), optics)
    if shape is None:
        return None
    if joined is not None:
        return None if expected_area_px is None else _disc(mask, box, shape, expected_area_px, joined)
    expected = expected_area_px or shape.area_px
    if not shape.is_partial and (shape.area_px >= _WHOLE * expected or shape.is_disc):
        return shape
    whole = None if expected_area_px is None else _disc(mask, box, shape, expected_area_px)
    if whole is not None:
        return whole
    missing = max(1 - shape.area_px / expected, _HIDDEN_AT_BORDER if shape.is_partial else 0.0)
    radius_px = optics.camera.focal_px * shape.angular_radius_rad / math.sqrt(1 - missing)
    off_px = _OFF_CENTER * missing * radius_px
    return replace(shape, cov_px=shape.cov_px + off_px**2 * np.eye(2), is_partial=True)


def _disc(mask: Mask, box: Box, visible: Outline, area_px: float, joined: Mask | None = None) -> Outline | None:
    """The outline of a disc of a known area (px) of which a mask (h, w) of the region `box` shows a part; None where
    the mask's edge, as far as it is one of `joined` (h, w) too, does not fit."""
    whole = mask if joined is None else joined
    contours, _ = cv2.findContours(whole.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(contours, key=len)[:, 0]
    edge = edge[mask[edge[:, 1], edge[:, 0]]].astype(float)
    inner = (edge > 0).all(axis=1) & (edge < np.array(mask.shape)[::-1] - 1).all(axis=1)
    if visible.area_px < _LEAST_VISIBLE * area_px or np.count_nonzero(inner) < _LEAST_EDGE_PX:
        return None
    radius = math.sqrt(area_px / math.pi)
    x, y, uu, uv, vv, share = _fit_circle(edge[inner], radius - 0.5)  # the edge's pixels lie inside
    if share < _ON_DISC:
        return None
    center, angle = (
        np.array([box[0] + x, box[1] + y]),
        visible.angular_radius_rad * math.sqrt(area_px / visible.area_px),
    )
    return Outline(
        *(center, np.array(((uu, uv), (uv, vv))), angle, (_SIZE_ERROR * angle) ** 2),
        *((center[0] - radius, center[1] - radius, 2 * radius, 2 * radius), area_px, True),
    )


@njit(cache=True, error_model="numpy")
def _fit_circle(edge: Array, radius: float) -> tuple[float, float, float, float, float, float]:
    """Centre x, y of the circle of a radius that most of the points (n, 2) lie on and none far outside of, its
    covariance uu, uv, vv, and the share of the points on it less those outside."""
    n, limit = len(edge), max(1.0, _SIZE_ERROR * radius)
    best, x, y = 0, 0.0, 0.0
    for i in range(0, n, max(n // 24, 1)):
        for apart in (n // 8, n // 4, n // 2):
            dx, dy = edge[(i + apart) % n, 0] - edge[i, 0], edge[(i + apart) % n, 1] - edge[i, 1]
            chord2 = dx * dx + dy * dy
            if chord2 < 0.25 * radius**2 or chord2 > 4 * radius**2:
                continue
            along = math.sqrt((radius**2 - 0.25 * chord2) / chord2)
            for side in (-along, along):
                u, v = edge[i, 0] + 0.5 * dx - side * dy, edge[i, 1] + 0.5 * dy + side * dx
                votes = 0
                for k in range(n):
                    off = math.hypot(edge[k, 0] - u, edge[k, 1] - v) - radius
                    votes += 1 if abs(off) < limit else -1 if off > 0 else 0
                if votes > best:
                    best, x, y = votes, u, v
    uu = uv = vv = gx = gy = 0.0
    for _ in range(3):
        a = b = c = p = q = gx = gy = 0.0
        for k in range(n):
            dx, dy = edge[k, 0] - x, edge[k, 1] - y
            far = math.hypot(dx, dy)
            if abs(far - radius) < limit:
                dx, dy = dx / far, dy / far
                a, b, c, gx, gy = a + dx * dx, b + dx * dy, c + dy * dy, gx + dx, gy + dy
                p, q = p + dx * (far - radius), q + dy * (far - radius)
        det = a * c - b * b
        if not det > 1e-6 * (a + c) ** 2:
            return x, y, 0.0, 0.0, 0.0, 0.0
        uu, uv, vv = c / det, -b / det, a / det
        x, y = x + uu * p + uv * q, y + uv * p + vv * q
    gx, gy = uu * gx + uv * gy, uv * gx + vv * gy  # ∂centre by the radius
    edge_var, radius_var = _CORRELATION * _EDGE_PX**2, (_SIZE_ERROR * radius) ** 2
    return (
        *(x, y, edge_var * uu + radius_var * gx * gx, edge_var * uv + radius_var * gx * gy),
        *(edge_var * vv + radius_var * gy * gy, best / n),
    )


def cover(image: Image, mask: Mask, box: Box) -> Coverage:
    """Soft coverage of a hard mask (h, w) of the region `box` of an RGB image.

    In a band around the mask's edge a pixel mixes the colours F just inside and B just outside, I = a·F + b·B.  a + b
    is near 1 but not bound to it, since the light on a round object falls off towards its rim.  The misfit gives the
    variance.
    """
    band = _BAND_PX if np.count_nonzero(mask) > _SMALL_PX else 1
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    beside = 3 * band + 3  # as far as the colours beside an edge are looked for
    left, top = max(x - beside, 0), max(y - beside, 0)
    part = np.s_[top : y + h + beside, left : x + w + beside]
    patch = image[box[1] : box[3], box[0] : box[2]][part].copy()
    corner = box[0] + left, box[1] + top
    around = (*corner, corner[0] + patch.shape[1], corner[1] + patch.shape[0])
    return Coverage(*covered(patch, mask[part].copy(), band), around)


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered, or its direction has no image."""
    left, top, _, _ = coverage.box
    seen = moments(coverage.alpha, coverage.variance, optics.weights, left, top)
    camera, area = optics.camera, seen.area
    if area < 1.0 or not seen.box[2]:
        return None
    u, v, of_u, of_v = camera.project_linearised(*seen.direction)
    if math.isnan(u):
        return None
    x, y, width, height = left + seen.box[0], top + seen.box[1], *seen.box[2:]
    radius, radius_var, uu, uv, vv = _covariance(seen.cov, seen.omega, area, camera.focal_px, of_u, of_v)
    cov = np.array(((uu, uv), (uv, vv)))
    at_border = x <= 0 or y <= 0 or x + width >= camera.width or y + height >= camera.height
    box_px = (float(x), float(y), float(width), float(height))
    edge, excess = harmonics(coverage.alpha, optics.weights, left, top, seen.direction, seen.omega)
    return Outline(np.array((u, v)), cov, radius, radius_var, box_px, area, at_border, edge, excess)


@njit(cache=True, error_model="numpy")
def _covariance(
    cov: Upper, omega: float, area: float, focal_px: float, of_u: Vector, of_v: Vector
) -> tuple[float, float, float, float, float]:
    """Angular radius (rad) of a cone of solid angle `omega` (sr), its variance, and the covariance uu, uv, vv of the
    centre's pixel.  `cov` as in `Moments`; ∂u and ∂v by the direction."""
    radius = math.acos(1 - min(omega / (2 * math.pi), 1.0))
    edge = EDGE_ERROR_PX**2 / math.sqrt(area / math.pi)
    xx, xy, xz, _, yy, yz, _, zz, _, oo = cov
    (a, b, c), (d, e, f) = of_u, of_v
    ux, uy, uz = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
    vx, vy, vz = xx * d + xy * e + xz * f, xy * d + yy * e + yz * f, xz * d + yz * e + zz * f
    uu, uv, vv = ux * a + uy * b + uz * c, ux * d + uy * e + uz * f, vx * d + vy * e + vz * f
    radius_var = _CORRELATION * oo / (2 * math.pi * math.sin(radius)) ** 2 + (EDGE_ERROR_PX / focal_px) ** 2
    return radius, radius_var, _CORRELATION * uu + edge, _CORRELATION * uv, _CORRELATION * vv + edge
