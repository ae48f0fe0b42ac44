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
from numba import njit
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera
from pps_vision.geometry.compiled import Vector
from pps_vision.types import Array, Image, Mask
from tracking.ego_motion import Box
from tracking.kernels import Moments, Upper, band_of, covered, moments

# What an outline's centre errs by however sharp its edge is (FACTS §7), over the radius (px) to the power 3/4: the
# fewer the pixels, the more each errs; and what light from above adds up and down in each eye by itself, over the
# radius's root: left out, it was taken for an error of the calibration, which counts in all directions.  Measured on
# rendered balls and markers of 5 to 35 px radius (bench consistency).
_LEAST_PX = 0.078
_LIGHT_PX = 0.06
# The same for its radius; half as much again as it errs by, since the edge that darkness takes from it also shifts
# its centre, and in a distance from its surface both errors add up.
_MIN_RADIUS_PX = 0.055
ROUND = 0.015  # departure from a disc up to which nothing is but a disc
_LIMBS_FROM, _LIMBS_TO = 0.08, 0.16  # share of limbs between which they come to count less than the trunk
_SHAPE_BIAS = 0.04  # of its size: how far the middle of an image that is no disc is from the object's centre
_CORRELATION = 2.0  # neighbouring pixels err together: this many are worth one


@dataclass(frozen=True)
class Coverage:
    """`alpha` (h, w) share of each pixel in `box` of the image that the object covers, and its `variance` (h, w), 0
    where it is plain."""

    alpha: NDArray[np.float32]
    variance: NDArray[np.float32]
    box: Box


@dataclass(frozen=True)
class Outline:
    """The object's centre (2,) px with covariance (2, 2) (but for what light from above does to it in both
    eyes alike: `TrackerParams.light_error`), angular radius and its variance, the box
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
    shown: "Outline | None" = None  # what shows of it, where this stands for the whole

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
        """(4, h, w) solid angle times viewing direction, and solid angle, sr."""
        camera = self.camera
        directions = np.concatenate([camera.bearing_map, np.ones((camera.height, camera.width, 1))], axis=-1)
        return np.ascontiguousarray(np.moveaxis(directions * camera.solid_angle_map[..., None], -1, 0), np.float32)

    @property
    def solid_angle(self) -> NDArray[np.float32]:
        """(h, w) sr."""
        return self.weights[3]


def cover(image: Image, mask: Mask, box: Box) -> Coverage:
    """Soft coverage from a hard mask (h, w) of the region `box` of an RGB image.

    In a band around the mask's edge a pixel mixes the colours F just inside and B just outside:
    I = a·F + b·B, with a + b near 1 but not bound to it, since light falls off towards the rim of a
    round object.  What is left over says how well that explains the pixel.
    """
    x0, y0, x1, y1 = box
    band = band_of(int(np.count_nonzero(mask)))
    return Coverage(*covered(image[y0:y1, x0:x1].copy(), mask.copy(), band), box)


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered."""
    left, top, _, _ = coverage.box
    return outline_of(moments(coverage.alpha, coverage.variance, optics.weights, left, top), coverage, optics)


def outline_of(seen: Moments, coverage: Coverage, optics: Optics) -> Outline | None:
    """The same where its moments are known."""
    alpha, (left, top, right, bottom) = coverage.alpha, coverage.box
    if seen.area < 1.0 or not seen.box[2]:
        return None
    direction = seen.direction
    if seen.outside / seen.area > ROUND:
        thick = alpha * _thickness(alpha)
        direction = np.vecdot(optics.weights[:3, top:bottom, left:right].reshape(3, -1), thick.reshape(-1)).tolist()
    return placed(seen, direction, (left, top), optics)


def placed(seen: Moments, direction: Vector, corner: tuple[int, int], optics: Optics) -> Outline | None:
    """The outline of a region with these moments, whose box is relative to `corner`, and whose centre lies in that
    `direction`; None where that cannot be seen."""
    camera, area = optics.camera, seen.area
    u, v, of_u, of_v = camera.project_linearised(*direction)
    if math.isnan(u):
        return None
    x, y, width, height = corner[0] + seen.box[0], corner[1] + seen.box[1], *seen.box[2:]
    fill = area / (math.pi / 4 * width * height)
    radius, radius_var, uu, uv, vv = _stated(seen.cov, seen.omega, area, fill, camera.focal_px, of_u, of_v)
    cov = np.array(((uu, uv), (uv, vv)))
    at_border = x <= 0 or y <= 0 or x + width >= camera.width or y + height >= camera.height
    box_px = (float(x), float(y), float(width), float(height))
    return Outline(np.array((u, v)), cov, radius, radius_var, box_px, area, at_border, seen.outside / area)


@njit(cache=True, error_model="numpy")
def _stated(
    cov: Upper, omega: float, area: float, fill: float, focal_px: float, of_u: Vector, of_v: Vector
) -> tuple[float, float, float, float, float]:
    """The angular radius of a cone of solid angle `omega` (rad, sr), its variance, and the variances uu, uv, vv of its
    centre's pixel; `cov` as in `Moments`, `fill` the share of its box's ellipse, ∂u and ∂v by its direction."""
    radius = math.acos(1 - min(omega / (2 * math.pi), 1.0))
    odd_px, radius_px = _SHAPE_BIAS * radius * focal_px * abs(1 - fill), math.sqrt(area / math.pi)
    own, light = _LEAST_PX**2 / radius_px**1.5 + odd_px**2, _LIGHT_PX**2 / radius_px
    xx, xy, xz, _, yy, yz, _, zz, _, oo = cov
    (a, b, c), (d, e, f) = of_u, of_v
    ux, uy, uz = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
    vx, vy, vz = xx * d + xy * e + xz * f, xy * d + yy * e + yz * f, xz * d + yz * e + zz * f
    uu, uv, vv = ux * a + uy * b + uz * c, ux * d + uy * e + uz * f, vx * d + vy * e + vz * f
    radius_var = _CORRELATION * oo / (2 * math.pi * math.sin(radius)) ** 2 + (_MIN_RADIUS_PX / focal_px) ** 2
    return radius, radius_var, _CORRELATION * uu + own, _CORRELATION * uv, _CORRELATION * vv + own + light


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
