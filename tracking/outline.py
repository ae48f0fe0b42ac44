"""Sub-pixel outline: which share of every pixel the object covers, and from it where its centre is.

A sphere's image is the cone of directions around its centre, so the mean viewing direction of its
pixels, each weighted by the solid angle it covers, is exactly the direction of its centre, and the
solid angle 2π(1 − cos θ) its angular radius θ: neither perspective nor the lens biases them.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera
from pps_vision.types import Array, Image, Mask
from tracking import masks
from tracking.ego_motion import Box

_MIN_STD_PX = 0.02  # sampling and shading leave this much however sharp the edge is (FACTS §7)
_SHADE_STD = 0.4  # how much the rim's brightness differs from that of the object just inside it
ROUND = 0.015  # departure from a disc up to which nothing is but a disc
_LIMBS_FROM, _LIMBS_TO = 0.08, 0.16  # share of limbs between which they come to count less than the trunk
_SHAPE_BIAS = 0.04  # of its size: how far the middle of an image that is no disc is from the object's centre
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
_CORRELATION = 4.0  # neighbouring pixels err together: this many are worth one


@dataclass(frozen=True)
class Coverage:
    """`alpha` (h, w) share of each pixel that the object covers and its variance, in `box` of the image."""

    alpha: NDArray[np.float32]
    variance: NDArray[np.float32]
    box: Box


@dataclass(frozen=True)
class Outline:
    """The object's centre (2,) px with covariance (2, 2), angular radius and its variance, the box
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


class Optics:
    """Per-pixel weights of one camera: solid angle and solid angle times direction, kept for every frame."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    @cached_property
    def solid_angle(self) -> NDArray[np.float32]:
        """(h, w) sr."""
        return self.camera.solid_angle_map.astype(np.float32)

    @cached_property
    def moments(self) -> NDArray[np.float32]:
        """(h, w, 3) viewing direction times solid angle."""
        return (self.camera.bearing_map * self.camera.solid_angle_map[..., None]).astype(np.float32)


def cover(image: Image, mask: Mask, box: Box) -> Coverage:
    """Soft coverage from a hard mask (h, w) of the region `box` of an RGB image.

    In a band around the mask's edge a pixel mixes the colours F just inside and B just outside:
    I = a·F + b·B, with a + b near 1 but not bound to it, since light falls off towards the rim of a
    round object.  What is left over says how well that explains the pixel.
    """
    x0, y0, x1, y1 = box
    roi = image[y0:y1, x0:x1].astype(np.float32)
    band = 2 if np.count_nonzero(mask) > 60 else 1
    inner = masks.eroded(mask, band)
    if not inner.any():
        inner = mask
    outer = ~masks.dilated(mask, band)
    edge = ~(inner | outer)
    window = (4 * band + 5, 4 * band + 5)
    F, B = _local_mean(roi, inner, window, edge), _local_mean(roi, outer, window, edge)
    alpha = inner.astype(np.float32)
    variance = np.zeros_like(alpha)
    if edge.any():
        alpha[edge], variance[edge] = _unmix(roi[edge], F, B)
    return Coverage(alpha, variance, box)


def _unmix(
    pixels: NDArray[np.float32], F: NDArray[np.float32], B: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of F (n,) in `pixels` (n, 3) that mix F and B, and its variance."""
    bound = _PIXEL_VAR / _SHADE_STD**2
    ff, bb = np.einsum("ij,ij->i", F, F) + bound, np.einsum("ij,ij->i", B, B) + bound
    fb = np.einsum("ij,ij->i", F, B) + bound
    fi, bi = np.einsum("ij,ij->i", F, pixels) + bound, np.einsum("ij,ij->i", B, pixels) + bound
    det = np.maximum(ff * bb - fb * fb, 1e-3)
    a = np.maximum((bb * fi - fb * bi) / det, 0.0)
    b = np.maximum((ff * bi - fb * fi) / det, 0.0)
    alpha = a / np.maximum(a + b, 1e-6)
    rest = pixels - a[:, None] * F - b[:, None] * B
    noise = float(np.mean(rest * rest)) + 1.0
    line = F - B
    contrast = np.maximum(np.einsum("ij,ij->i", line, line), 1.0)
    variance = np.minimum(noise / contrast, 0.25)
    return alpha.astype(np.float32), variance.astype(np.float32)


def _local_mean(roi: NDArray[np.float32], where: Mask, window: tuple[int, int], at: Mask) -> NDArray[np.float32]:
    """(n, 3) mean colour of the marked pixels around each pixel of `at`; of all marked ones where
    none is near."""
    weight = where.astype(np.float32)
    marked = roi * weight[..., None]
    total = cv2.boxFilter(marked, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)[at]
    count = cv2.boxFilter(weight, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)[at, None]
    mean = np.asarray(total / np.maximum(count, 1.0), dtype=np.float32)
    alone = count[:, 0] < 0.5
    if alone.any():
        mean[alone] = marked.sum(axis=(0, 1)) / max(float(weight.sum()), 1.0)
    return mean


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered."""
    x0, y0, x1, y1 = coverage.box
    alpha = coverage.alpha
    area = float(alpha.sum())
    if area < 1.0:
        return None
    solid = optics.solid_angle[y0:y1, x0:x1]
    moments = optics.moments[y0:y1, x0:x1]
    direction = _mean_direction(alpha, moments)
    omega = float((alpha * solid).sum())
    radius = float(np.arccos(1 - min(omega / (2 * np.pi), 1.0)))
    departure = _departure(alpha, solid, moments, direction, radius)
    if departure > ROUND:
        direction = _mean_direction(alpha * _thickness(alpha), moments)
    center = optics.camera.project(direction)
    if not np.all(np.isfinite(center)):
        return None
    omega_var = _CORRELATION * float((coverage.variance * solid * solid).sum())
    radius_var = omega_var / (2 * np.pi * np.sin(radius)) ** 2
    columns, rows = np.flatnonzero((alpha > 0.5).any(axis=0)), np.flatnonzero((alpha > 0.5).any(axis=1))
    if not len(columns):
        return None
    left, top = x0 + columns[0], y0 + rows[0]
    right, bottom = x0 + columns[-1] + 1, y0 + rows[-1] + 1
    width, height = optics.camera.width, optics.camera.height
    odd_px = (
        _SHAPE_BIAS * radius * optics.camera.focal_px * abs(1 - area / (np.pi / 4 * (right - left) * (bottom - top)))
    )
    cov = _center_cov(coverage, center, area) + odd_px**2 * np.eye(2)
    at_border = bool(left <= 0 or top <= 0 or right >= width or bottom >= height)
    box_px = (float(left), float(top), float(right - left), float(bottom - top))
    return Outline(center, cov, radius, radius_var, box_px, area, at_border, departure)


def _mean_direction(weight: NDArray[np.float32], moments: NDArray[np.float32]) -> Array:
    """(3,) mean of the viewing directions, weighted per pixel."""
    direction = np.einsum("ij,ijk->k", weight, moments).astype(float)
    unit: Array = direction / max(float(np.linalg.norm(direction)), 1e-30)
    return unit


def _departure(
    alpha: NDArray[np.float32], solid: NDArray[np.float32], moments: NDArray[np.float32], axis: Array, radius: float
) -> float:
    """Share of the covered solid angle outside the cone around `axis` of as much solid angle; pixels on
    the cone's edge are not counted, for what they are is uncertain."""
    covered = alpha * solid
    edge = float(np.sqrt(solid.max()))  # a pixel's side as an angle
    outside = moments @ axis.astype(np.float32) < np.float32(np.cos(radius + edge)) * solid
    return float(covered[outside].sum() / covered.sum())


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


def _center_cov(coverage: Coverage, center: Array, area: float) -> Array:
    """(2, 2) px²: every edge pixel's uncertain share pulls the centre by its lever arm."""
    x0, y0, x1, y1 = coverage.box
    x, y = np.arange(x0, x1) - center[0], np.arange(y0, y1) - center[1]
    v = coverage.variance
    xx, yy, xy = float((v @ (x * x)).sum()), float(((y * y) @ v).sum()), float(y @ v @ x)
    return _CORRELATION * np.array([[xx, xy], [xy, yy]]) / area**2 + _MIN_STD_PX**2 * np.eye(2)
