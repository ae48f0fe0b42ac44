"""Sub-pixel outline: which share of every pixel the object covers, and from it where its centre is.

A sphere's image is the cone of directions around its centre, so the mean viewing direction of its
pixels, each weighted by the solid angle it covers, is exactly the direction of its centre, and the
solid angle 2π(1 − cos θ) its angular radius θ: neither perspective nor the lens biases them.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera
from pps_vision.types import Array, Image, Mask
from tracking import masks
from tracking.ego_motion import Box

# Sampling leaves this much of an outline's centre however sharp its edge is (FACTS §7); times √radius (px), for
# the fewer the pixels, the more each errs.
_LEAST_PX = 0.02
_MIN_RADIUS_PX = 0.045  # the same for its radius
_SHADE_STD = 0.4  # how much the rim's brightness differs from that of the object just inside it
ROUND = 0.015  # departure from a disc up to which nothing is but a disc
_LIMBS_FROM, _LIMBS_TO = 0.08, 0.16  # share of limbs between which they come to count less than the trunk
_SHAPE_BIAS = 0.04  # of its size: how far the middle of an image that is no disc is from the object's centre
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
_CORRELATION = 2.0  # neighbouring pixels err together: this many are worth one

_UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: in this unit a + b is as sure to be 1 as a pixel its level


@dataclass(frozen=True)
class Coverage:
    """`alpha` (h, w) share of each pixel in `box` of the image that the object covers, and its `variance` (n,)
    in those pixels where it is not plain: `edge` (n,) counts them row by row."""

    alpha: NDArray[np.float32]
    edge: NDArray[np.intp]
    variance: NDArray[np.float32]
    box: Box


@dataclass(frozen=True)
class Outline:
    """The object's centre (2,) px with covariance (2, 2) (but for what light from above does to it, which both eyes
    share: `TrackerParams.light_error`), angular radius and its variance, the box
    (x, y, width, height) around it, its area in px, whether it meets the image's border, and what share
    of it lies beyond the disc (a sphere's cone) of the same size."""

    center_px: Array
    cov_px: Array
    angular_radius_rad: float
    angular_radius_var: float
    box_px: tuple[float, float, float, float]
    area_px: float
    at_border: bool
    departure: float

    @property
    def oddness(self) -> float:
        """0 for the image of a ball, 1 for what is clearly something else (a cube, a toy with limbs)."""
        return min(max((self.departure - ROUND) / ROUND, 0.0), 1.0)


class Optics:
    """Per-pixel weights of one camera: solid angle and solid angle times direction, kept for every frame."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    @cached_property
    def weights(self) -> NDArray[np.float32]:
        """(h, w, 4) solid angle times viewing direction, and solid angle, sr."""
        solid = self.camera.solid_angle_map[..., None]
        return np.concatenate([self.camera.bearing_map * solid, solid], axis=-1).astype(np.float32)

    @property
    def moments(self) -> NDArray[np.float32]:
        """(h, w, 3) viewing direction times solid angle."""
        return self.weights[..., :3]

    @property
    def solid_angle(self) -> NDArray[np.float32]:
        """(h, w) sr."""
        return self.weights[..., 3]


def cover(image: Image, mask: Mask, box: Box) -> Coverage:
    """Soft coverage from a hard mask (h, w) of the region `box` of an RGB image.

    In a band around the mask's edge a pixel mixes the colours F just inside and B just outside:
    I = a·F + b·B, with a + b near 1 but not bound to it, since light falls off towards the rim of a
    round object.  What is left over says how well that explains the pixel.
    """
    x0, y0, x1, y1 = box
    band = 2 if np.count_nonzero(mask) > 60 else 1
    inner = masks.eroded(mask, band)
    if not inner.any():
        inner = mask
    outer = ~masks.dilated(mask, band)
    edge = np.flatnonzero(inner == outer)
    alpha = inner.astype(np.float32)
    if not len(edge):
        return Coverage(alpha, edge, np.zeros(0, np.float32), box)
    # the fourth channel is 1: it counts pixels in a sum, and in a mixture it asks for a + b = 1
    roi = np.asarray(cv2.cvtColor(image[y0:y1, x0:x1] * np.float32(1 / _UNIT), cv2.COLOR_RGB2RGBA), dtype=np.float32)
    side = 4 * band + 5
    F, B = _local_mean(roi, inner, side, edge), _local_mean(roi, outer, side, edge)
    share, variance = _unmix(roi.reshape(-1, 4).take(edge, axis=0), F, B)
    alpha.reshape(-1)[edge] = share
    return Coverage(alpha, edge, variance, box)


def _unmix(
    pixels: NDArray[np.float32], F: NDArray[np.float32], B: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of F (n, 4) in `pixels` (n, 4) that mix F and B, and its variance."""
    ff, bb, fb = np.vecdot(F, F), np.vecdot(B, B), np.vecdot(F, B)
    fi, bi = np.vecdot(F, pixels), np.vecdot(B, pixels)
    det = np.maximum(ff * bb - fb * fb, 1e-7)
    a, b = np.maximum((bb * fi - fb * bi) / det, 0), np.maximum((ff * bi - fb * fi) / det, 0)
    rest = (pixels - a[:, None] * F - b[:, None] * B)[:, :3].ravel()
    noise = float(rest @ rest) / len(rest) + 1 / _UNIT**2
    contrast = np.maximum(ff + bb - 2 * fb, 1 / _UNIT**2)
    share, variance = a / np.maximum(a + b, 1e-6), np.minimum(noise / contrast, 0.25)
    return share.astype(np.float32), variance.astype(np.float32)


def _local_mean(roi: NDArray[np.float32], where: Mask, side: int, at: NDArray[np.intp]) -> NDArray[np.float32]:
    """(n, 4) mean colour of the marked pixels of `roi` (h, w, 4) around each of the pixels `at`; of all marked
    ones where none is near."""
    marked = cv2.copyTo(roi, where.view(np.uint8))
    total = cv2.boxFilter(marked, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    near = np.asarray(total, dtype=np.float32).reshape(-1, 4).take(at, axis=0)
    count = near[:, 3:]
    if count.min() < 0.5:
        near[count[:, 0] < 0.5] = cv2.sumElems(marked)
    return np.asarray(near / np.maximum(count, 1.0), dtype=np.float32)


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered."""
    x0, y0, x1, y1 = coverage.box
    alpha = coverage.alpha
    area = cv2.sumElems(alpha)[0]
    if area < 1.0:
        return None
    weights = optics.weights[y0:y1, x0:x1].reshape(-1, 4)
    *direction, omega = (alpha.reshape(-1) @ weights).tolist()
    radius = math.acos(1 - min(omega / (2 * math.pi), 1.0))
    departure = _departure(alpha, weights, direction, omega, radius)
    if departure > ROUND:
        direction = ((alpha * _thickness(alpha)).reshape(-1) @ weights)[:3].tolist()
    center = optics.camera.project(direction)
    if not (math.isfinite(center[0]) and math.isfinite(center[1])):
        return None
    left, top, width, height = cv2.boundingRect((alpha > 0.5).view(np.uint8))
    if not width:
        return None
    left, top = x0 + left, y0 + top
    solid = weights[:, 3].take(coverage.edge)
    omega_var = _CORRELATION * float(np.dot(coverage.variance * solid, solid))
    radius_var = omega_var / (2 * math.pi * math.sin(radius)) ** 2 + (_MIN_RADIUS_PX / optics.camera.focal_px) ** 2
    odd_px = _SHAPE_BIAS * radius * optics.camera.focal_px * abs(1 - area / (math.pi / 4 * width * height))
    cov = _center_cov(coverage, center.tolist(), area)
    cov[[0, 1], [0, 1]] += odd_px**2
    at_border = left <= 0 or top <= 0 or left + width >= optics.camera.width or top + height >= optics.camera.height
    box_px = (float(left), float(top), float(width), float(height))
    return Outline(center, cov, radius, radius_var, box_px, area, at_border, departure)


def _departure(
    alpha: NDArray[np.float32], weights: NDArray[np.float32], direction: list[float], omega: float, radius: float
) -> float:
    """Share of the covered solid angle `omega` outside the cone around `direction` of as much solid angle; pixels on
    the cone's edge are not counted, for what they are is uncertain."""
    solid = weights[:, 3]
    length, edge = math.hypot(*direction), math.sqrt(solid.max())  # a pixel's side as an angle
    inside = np.array([*direction, -length * math.cos(radius + edge)], dtype=np.float32)
    return float((alpha.reshape(-1) * solid) @ (weights @ inside < 0)) / omega


def _thickness(alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) about how deep the body is at every pixel, relative to its mean: as in a round body of that
    outline, what is far from the outline is thick.  1 everywhere where there are no limbs, parts
    thinner than 0.4 of the disc of the same area."""
    inside = cv2.copyMakeBorder((alpha > 0.5).view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    area = max(int(np.count_nonzero(inside)), 1)
    to_edge = np.asarray(cv2.distanceTransform(inside, cv2.DIST_L2, 5), dtype=np.float32)
    thin = 0.4 * np.sqrt(area / np.pi)
    to_core = np.asarray(cv2.distanceTransform((to_edge <= thin).view(np.uint8), cv2.DIST_L2, 5))
    limb_share = 1 - int(np.count_nonzero(to_core < thin)) / area
    limbs = min(max((limb_share - _LIMBS_FROM) / (_LIMBS_TO - _LIMBS_FROM), 0.0), 1.0)
    depth = np.sqrt(to_edge[1:-1, 1:-1])
    mean = float(depth.sum()) / area
    thickness: NDArray[np.float32] = ((1 - limbs) + limbs * depth / max(mean, 1e-6)).astype(np.float32)
    return thickness


def _center_cov(coverage: Coverage, center: list[float], area: float) -> Array:
    """(2, 2) px²: every edge pixel's uncertain share pulls the centre by its lever arm."""
    variance = np.zeros_like(coverage.alpha)
    variance.reshape(-1)[coverage.edge] = coverage.variance
    m = cv2.moments(variance)
    x, y = center[0] - coverage.box[0], center[1] - coverage.box[1]
    xx = m["m20"] - x * (2 * m["m10"] - x * m["m00"])
    yy = m["m02"] - y * (2 * m["m01"] - y * m["m00"])
    xy = m["m11"] - x * m["m01"] - y * (m["m10"] - x * m["m00"])
    return _CORRELATION / area**2 * np.array([[xx, xy], [xy, yy]]) + least_cov(area)


def least_cov(area: float) -> Array:
    """(2, 2) px² of the centre of an outline of `area` px, however sharp its edge; measured on rendered
    balls and markers of 5 to 35 px radius (bench consistency)."""
    return _LEAST_PX**2 / math.sqrt(area / math.pi) * np.eye(2)
