"""Sub-pixel outline: which share of every pixel the object covers, and from it where its centre is.

A sphere's image is the cone of directions around its centre, so the mean viewing direction of its
pixels, each weighted by the solid angle it covers, is exactly the direction of its centre, and the
solid angle 2π(1 − cos θ) its angular radius θ: neither perspective nor the lens biases them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, Vector
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
_BAND = 2  # px, to both sides of a hard mask's edge in which a pixel may be partly covered
CLEAR = 3  # px around, so that no edge pixel is compared with the colours inside another region
ROOM = 5  # px further around, of the colours outside that an edge pixel is compared with


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
    alpha, edge, variance = _cover(image[None, y0:y1, x0:x1], mask[None])
    return Coverage(alpha[0], edge, variance, box)


def outline_pair(
    patches: Image, masks: Mask, boxes: tuple[Box, Box], optics: tuple[Optics, Optics]
) -> list[Outline | None]:
    """The outline in a region of each eye, both of one size: calls on arrays this small take as long for both as for
    one.  `patches` (2, h + 2·ROOM, w + 2·ROOM, 3) show that much around the regions; in the hard `masks` (2, h, w)
    nothing may be marked within `CLEAR` px of their border."""
    return _outlines(*_cover(patches, masks), boxes, optics)


def _cover(patches: Image, masks: Mask) -> tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.float32]]:
    """Alpha (k, h, w), edge (n,) and variance (n,) of k regions of one size, as a Coverage has them, one after the
    other; of RGB patches (k, h + 2m, w + 2m, 3), which may show more to all sides, and hard masks (k, h, w)."""
    k, h, w = masks.shape
    band = _BAND if np.count_nonzero(masks) > 60 * k else 1
    side = 2 * band + 1
    hard = masks.reshape(-1, w).view(np.uint8)
    count = cv2.boxFilter(hard, -1, (side, side), normalize=False, borderType=cv2.BORDER_REPLICATE)
    inner, outer = count == side * side, count == 0
    if not np.count_nonzero(inner):
        inner = hard.view(bool)
    edge = (inner == outer).ravel().nonzero()[0]
    alpha = inner.astype(np.float32)
    if not len(edge):
        return alpha.reshape(k, h, w), edge, np.zeros(0, np.float32)
    colors = _colors(patches, inner.reshape(k, h, w), outer.reshape(k, h, w), 4 * band + 5, edge)
    alpha.reshape(-1)[edge], variance = _unmix(colors)
    return alpha.reshape(k, h, w), edge, variance


def _colors(patches: Image, inner: Mask, outer: Mask, side: int, at: NDArray[np.intp]) -> NDArray[np.float32]:
    """(3, 4, n) of each of the pixels `at`: its own colour, and the mean colours of the inner and the outer pixels
    around; of all such pixels where none is near.  Red, green and blue are in 0–1, the fourth channel is 1."""
    (k, h, w), (_, height, width, _) = inner.shape, patches.shape
    m = (height - h) // 2
    rgba = np.asarray(cv2.cvtColor(patches.reshape(-1, width, 3), cv2.COLOR_RGB2RGBA), np.uint8)  # A counts in a sum
    middle = rgba.view(np.uint32).reshape(k, height, width)[:, m : m + h, m : m + w]
    inside: NDArray[np.uint8] = (middle * inner).view(np.uint8).reshape(k * h, w, 4)
    layers = np.empty((3, k * h, w, 4), np.float32)
    layers[0] = middle[..., None].view(np.uint8).reshape(k * h, w, 4)
    middle *= outer
    square = side, side
    cv2.boxFilter(inside, cv2.CV_32F, square, layers[1], normalize=False, borderType=cv2.BORDER_CONSTANT)
    around = cv2.boxFilter(rgba, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT)
    layers[2] = around.reshape(k, height, width, 4)[:, m : m + h, m : m + w].reshape(k * h, w, 4)
    colors = layers.reshape(3, -1, 4).take(at, axis=1).swapaxes(1, 2).copy()
    if cv2.countNonZero(colors[1:, 3]) < 2 * len(at):
        for color, marked in zip(colors[1:], (inside, rgba), strict=True):
            color[:, color[3] == 0] = marked.reshape(-1, 4).sum(axis=0, dtype=np.float32)[:, None]
    colors /= colors[:, 3:]
    return colors


def _unmix(colors: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of F in each pixel I, and its variance, of `colors` (3, 4, n), I, F and B, as `_colors` has them.

    The fourth channel, where all three are the same, asks of the mixture that a + b = 1.
    """
    colors[:, 3] = _SHADE
    products = _SUM @ (colors[1:, None] * colors)  # of F and B with I, F and B
    with_pixel, own, fb = products[:, 0], products.reshape(6, -1)[1::4], products[0, 2]
    ff, bb = own
    both = own[::-1] * with_pixel  # Cramer's rule
    both -= fb * with_pixel[::-1]
    np.maximum(both, 0, out=both)
    both /= np.maximum(ff * bb - fb * fb, 1e-11)
    a, b = both
    mixed = both[:, None] * colors[1:, :3]
    rest = colors[0, :3] - mixed[0] - mixed[1]
    noise = float(np.vdot(rest, rest)) / rest.size + _LEVEL_VAR
    return a / np.maximum(a + b, 1e-6), noise / np.maximum(ff + bb - 2 * fb, 4 * noise)  # a quarter at most


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """The outline of a covered region; None where nothing is covered."""
    c = coverage
    return _outlines(c.alpha[None], c.edge, c.variance, (c.box,), (optics,))[0]


def _outlines(
    alpha: NDArray[np.float32],
    edge: NDArray[np.intp],
    variance: NDArray[np.float32],
    boxes: Sequence[Box],
    optics: Sequence[Optics],
) -> list[Outline | None]:
    """The outline in each of k regions of one size; `alpha` (k, h, w), `edge` and `variance` (n,) are as in a Coverage,
    with one region after the other."""
    planes = np.empty((4, *alpha.shape), np.float32)
    for index, (eye, (x0, y0, x1, y1)) in enumerate(zip(optics, boxes, strict=True)):
        planes[:, index] = eye.weights[:, y0:y1, x0:x1]
    weights, flat = planes.reshape(4, len(alpha), -1).swapaxes(0, 1), alpha.reshape(len(alpha), -1)
    sums, areas = (weights @ flat[..., None])[..., 0].tolist(), flat.sum(axis=1).tolist()
    outside = _outside(flat, weights, sums, areas)
    plain = (alpha > 0.5).view(np.uint8)
    of_edge, begin = planes.reshape(4, -1).take(edge, axis=1), 0
    spread = variance * of_edge
    found: list[Outline | None] = []
    for index, (*direction, omega) in enumerate(sums):
        end = int(edge.searchsorted((index + 1) * flat.shape[1]))
        area, departure = areas[index], outside[index] / max(areas[index], 1.0)
        if departure > ROUND:
            thick = alpha[index] * _thickness(alpha[index])
            direction = (weights[index, :3] @ thick.reshape(-1)).tolist()
        cov = (spread[:, begin:end] @ of_edge[:, begin:end].T).tolist()
        moments = _Moments(direction, omega, area, departure, cov, cv2.boundingRect(plain[index]))
        found.append(_outline(moments, boxes[index], optics[index].camera))
        begin = end
    return found


class _Moments(NamedTuple):
    """Of what is covered: the sums of its `direction`s (3,) and of its solid angles, `omega` sr, with the covariance
    (4, 4) of both were pixels to err apart; area px, share that departs from a disc, box x, y, width, height."""

    direction: list[float]
    omega: float
    area: float
    departure: float
    cov: list[list[float]]
    box: Sequence[int]


def _outline(seen: _Moments, region: Box, camera: Camera) -> Outline | None:
    """What those sums say of the object; None where nothing is covered."""
    left, top, width, height = seen.box
    if seen.area < 1.0 or not width:
        return None
    u, v, of_u, of_v = camera.project_linearised(*seen.direction)
    if math.isnan(u):
        return None
    left, top, focal_px, area = region[0] + left, region[1] + top, camera.focal_px, seen.area
    radius = _angle(seen.omega)
    odd_px = _SHAPE_BIAS * radius * focal_px * abs(1 - area / (math.pi / 4 * width * height))
    radius_px = math.sqrt(area / math.pi)
    own, light = _LEAST_PX**2 / radius_px**1.5 + odd_px**2, _LIGHT_PX**2 / radius_px
    cov_u, cov_v = _turned(seen.cov, of_u), _turned(seen.cov, of_v)
    uu, uv, vv = _CORRELATION * _dot(cov_u, of_u), _CORRELATION * _dot(cov_u, of_v), _CORRELATION * _dot(cov_v, of_v)
    cov = np.array(((uu + own, uv), (uv, vv + own + light)))
    omega_var = _CORRELATION * seen.cov[3][3]
    radius_var = omega_var / (2 * math.pi * math.sin(radius)) ** 2 + (_MIN_RADIUS_PX / focal_px) ** 2
    at_border = left <= 0 or top <= 0 or left + width >= camera.width or top + height >= camera.height
    box_px = (float(left), float(top), float(width), float(height))
    return Outline(np.array((u, v)), cov, radius, radius_var, box_px, area, at_border, seen.departure)


def _angle(omega: float) -> float:
    """Half the angle (rad) of the cone of a solid angle (sr)."""
    return math.acos(1 - min(omega / (2 * math.pi), 1.0))


def _outside(
    alpha: NDArray[np.float32], weights: NDArray[np.float32], sums: list[list[float]], areas: list[float]
) -> list[float]:
    """What of each region's `alpha` (k, h·w) lies more than a pixel's side outside the cone of its solid angle around
    its direction, px; `weights` (k, 4, h·w), and their `sums` (k, 4)."""
    cones = []
    for (x, y, z, omega), area in zip(sums, areas, strict=True):
        reach = _angle(omega) + math.sqrt(max(omega, 0.0) / max(area, 1.0))
        cones.append([[x, y, z, -math.sqrt(x * x + y * y + z * z) * math.cos(reach)]])
    outside = np.array(cones, np.float32) @ weights < 0
    total: list[float] = (outside @ alpha[..., None]).ravel().tolist()
    return total


def _turned(cov: list[list[float]], slope: Vector) -> Vector:
    """The product of the first three rows and columns of a symmetric matrix with a vector."""
    (a, b, c, _), (_, d, e, _), (_, _, f, _), _ = cov
    x, y, z = slope
    return a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


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
