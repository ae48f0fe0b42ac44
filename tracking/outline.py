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
from tracking.ego_motion import Box

# What an outline's centre errs by however sharp its edge is (FACTS §7), over the radius (px) to the power 3/4: the
# fewer the pixels, the more each errs; and what light from above adds up and down in each eye by itself, over the
# radius's root: left out, it was taken for an error of the calibration, which counts in all directions.  Measured on
# rendered balls and markers of 5 to 35 px radius (bench consistency).
_LEAST_PX = 0.078
_LIGHT_PX = 0.06
# The same for its radius; half as much again as it errs by, since the edge that darkness takes from it also shifts
# its centre, and in a distance from its surface both errors add up.
_MIN_RADIUS_PX = 0.055
_SHADE_STD = 0.4  # how much the rim's brightness differs from that of the object just inside it
ROUND = 0.015  # departure from a disc up to which nothing is but a disc
_LIMBS_FROM, _LIMBS_TO = 0.08, 0.16  # share of limbs between which they come to count less than the trunk
_SHAPE_BIAS = 0.04  # of its size: how far the middle of an image that is no disc is from the object's centre
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
_CORRELATION = 2.0  # neighbouring pixels err together: this many are worth one

_UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: in this unit a + b is as sure to be 1 as a pixel its level
_SHADE = np.float32(_UNIT / 255)
_LEVEL_VAR = np.float32(1 / 255**2)  # of rounding and the like
_SUM = np.ones(4, np.float32)
REACH = 8  # px, of the colours that an edge pixel is compared with: half a window, and the band


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
    return Coverage(*_cover(image[y0:y1, x0:x1], mask, int(np.count_nonzero(mask))), box)


def cover_pair(patches: Image, mask: Mask, boxes: tuple[Box, Box]) -> tuple[Coverage, Coverage]:
    """The same for a region of each eye, both of one size and one above the other in `patches` (2h, w, 3) and `mask`
    (2h, w): calls on arrays this small take as long for both as for one.  Nothing may be marked within `REACH`
    px of where they meet."""
    alpha, edge, variance = _cover(patches, mask, int(np.count_nonzero(mask)) // 2)
    half = alpha.size // 2
    of_left = int(np.searchsorted(edge, half))
    upper, lower = alpha.reshape(2, -1, alpha.shape[1])
    return (
        Coverage(upper, edge[:of_left], variance[:of_left], boxes[0]),
        Coverage(lower, edge[of_left:] - half, variance[of_left:], boxes[1]),
    )


def _cover(patch: Image, mask: Mask, area: int) -> tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.float32]]:
    """Alpha (h, w), edge (n,) and variance (n,) of a Coverage, of an RGB patch (h, w, 3) and its hard mask."""
    band = 2 if area > 60 else 1
    side = 2 * band + 1
    count = cv2.boxFilter(mask.view(np.uint8), -1, (side, side), normalize=False, borderType=cv2.BORDER_REPLICATE)
    inner, outer = count == side * side, count == 0
    if not np.count_nonzero(inner):
        inner = mask
    edge = (inner == outer).ravel().nonzero()[0]
    alpha = inner.astype(np.float32)
    if not len(edge):
        return alpha, edge, np.zeros(0, np.float32)
    share, variance = _unmix(_colors(patch, inner, outer, 4 * band + 5, edge))
    alpha.reshape(-1)[edge] = share
    return alpha, edge, variance


def _colors(patch: Image, inner: Mask, outer: Mask, side: int, at: NDArray[np.intp]) -> NDArray[np.float32]:
    """(3, 4, n) of each of the pixels `at`: its own colour, and the mean colours of the inner and the outer pixels
    around; of all such pixels where none is near.  Red, green and blue are in 0–1, the fourth channel is 1."""
    layers = np.empty((3, *inner.shape, 4), np.float32)
    rgba = cv2.cvtColor(patch, cv2.COLOR_RGB2RGBA)  # A counts the pixels in a sum
    layers[0] = rgba
    for layer, where in zip(layers[1:], (inner, outer), strict=True):
        marked = cv2.copyTo(rgba, where.view(np.uint8))
        cv2.boxFilter(marked, cv2.CV_32F, (side, side), layer, normalize=False, borderType=cv2.BORDER_CONSTANT)
    colors = layers.reshape(3, -1, 4).take(at, axis=1).swapaxes(1, 2).copy()
    if np.count_nonzero(colors[:, 3]) < 3 * len(at):
        for color, where in zip(colors[1:], (inner, outer), strict=True):
            color[:, color[3] == 0] = np.array([*cv2.mean(rgba, where.view(np.uint8))[:3], 255])[:, None]
    return np.asarray(colors / colors[:, 3:], dtype=np.float32)


def _unmix(colors: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of F in each pixel I, and its variance, of `colors` (3, 4, n), I, F and B, as `_colors` has them.

    The fourth channel, where all three are the same, asks of the mixture that a + b = 1.
    """
    colors[:, 3] = _SHADE
    (fi, ff, fb), (bi, _, bb) = _SUM @ (colors[1:, None] * colors)
    det = np.maximum(ff * bb - fb * fb, 1e-11)
    a, b = np.maximum(bb * fi - fb * bi, 0) / det, np.maximum(ff * bi - fb * fi, 0) / det
    pixel, F, B = colors[:, :3]
    rest = pixel - a * F - b * B
    noise = float(np.vdot(rest, rest)) / rest.size + _LEVEL_VAR
    return a / np.maximum(a + b, 1e-6), np.minimum(noise / np.maximum(ff + bb - 2 * fb, _LEVEL_VAR), 0.25)


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered."""
    x0, y0, x1, y1 = coverage.box
    alpha, camera = coverage.alpha, optics.camera
    area = cv2.sumElems(alpha)[0]
    if area < 1.0:
        return None
    weights = optics.weights[:, y0:y1, x0:x1].reshape(4, -1)
    *direction, omega = (weights @ alpha.reshape(-1)).tolist()
    radius = math.acos(1 - min(omega / (2 * math.pi), 1.0))
    departure = _departure(alpha, weights, direction, radius + math.sqrt(omega / area)) / area  # and a pixel's side
    if departure > ROUND:
        direction = (weights[:3] @ (alpha * _thickness(alpha)).reshape(-1)).tolist()
    u, v, *slopes = camera.project_linearised(*direction)
    center, slope = np.array((u, v)), np.array(slopes)
    if math.isnan(center[0]):
        return None
    left, top, width, height = cv2.boundingRect((alpha > 0.5).view(np.uint8))
    if not width:
        return None
    left, top = x0 + left, y0 + top
    focal_px = camera.focal_px
    odd_px = _SHAPE_BIAS * radius * focal_px * abs(1 - area / (math.pi / 4 * width * height))
    ((xx, xy), (_, yy)), omega_var = _spread(coverage, weights, slope)
    radius_px = math.sqrt(area / math.pi)
    own, light = _LEAST_PX**2 / radius_px**1.5 + odd_px**2, _LIGHT_PX**2 / radius_px
    cov = np.array(((xx + own, xy), (xy, yy + own + light)))
    radius_var = omega_var / (2 * math.pi * math.sin(radius)) ** 2 + (_MIN_RADIUS_PX / focal_px) ** 2
    at_border = left <= 0 or top <= 0 or left + width >= camera.width or top + height >= camera.height
    box_px = (float(left), float(top), float(width), float(height))
    return Outline(center, cov, radius, radius_var, box_px, area, at_border, departure)


def _departure(
    alpha: NDArray[np.float32], weights: NDArray[np.float32], direction: list[float], radius: float
) -> float:
    """What of `alpha` lies outside the cone of this `radius` (rad) around a direction, px."""
    inside = np.array([*direction, -math.hypot(*direction) * math.cos(radius)], dtype=np.float32)
    return float(alpha.reshape(-1) @ (inside @ weights < 0))


def _spread(coverage: Coverage, weights: NDArray[np.float32], slope: Array) -> tuple[list[list[float]], float]:
    """Covariance (2, 2) px² of the centre and variance sr² of the solid angle: what every edge pixel's uncertain share
    does to the sums of the weights, and with `slope` (2, 3) the sum of the directions to the centre."""
    of_edge = weights.take(coverage.edge, axis=1)
    cov = (_CORRELATION * coverage.variance * of_edge) @ of_edge.T
    return (slope @ cov[:3, :3] @ slope.T).tolist(), float(cov[3, 3])


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
