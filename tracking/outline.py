"""Sub-pixel outline of an object: centre and angular radius from the share of every pixel that it covers.

A sphere's image is the cone of directions around its centre.  The mean viewing direction of its pixels, weighted by
the covered solid angle, is the direction of its centre, and the solid angle 2π(1 − cos θ) gives its angular radius θ.
Neither perspective nor lens distortion biases them.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import Camera, solid_angles
from pps_vision.geometry.compiled import Vector
from pps_vision.geometry.masks import Box
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

_SHADE_STD = 0.4  # relative standard deviation of the rim's brightness from that of the object just inside it
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: weight of the condition a + b = 1 beside one pixel's level
_LEVEL_VAR = 1.0  # grey levels²: smallest variance of a pixel (rounding)
_MIN_DET = 0.04  # grey levels⁴, below which both colours are the same
_MASK_VAR = 1 / 12  # variance of the hard mask as an estimate of a pixel's share: an edge anywhere in the pixel
_EDGE = 0
_INNER = 1
_OUTER = 2

SHARP_PX = 0.68  # most blur of an edge by a sharp lens and the sensor
_TO_BLUR = math.sqrt(math.pi)  # standard deviation of a blurred edge's share a over ∫a (1 − a)
_LUMA = (0.3, 0.6, 0.1)  # red, green and blue in an image's brightness

Map = NDArray[np.float32]
Color = tuple[float, float, float]
EDGE_ERROR_PX = 0.065
"""Systematic error of an edge's position (shading, background), correlated along the edge: an outline of radius r px
has a centre error of EDGE_ERROR_PX / √r and a radius error of EDGE_ERROR_PX, px.  Measured on ray-cast balls of 5 to 30
px radius, lit from above, across the light (tests/tracking/test_outline.py)."""
_BAND_PX = 2  # on both sides of a hard mask's edge, in which a pixel may be partly covered
_SMALL_PX = 60  # area up to which the band is half as wide
_CORRELATION = 2.0  # neighbouring pixels share their error: two count as one
_WHOLE = 0.85  # share of the expected area below which part of the object is hidden
_OFF_CENTER = 4 / (3 * math.pi) / 0.5 / math.sqrt(2)  # half a disc's centroid is 4/(3π) of its radius off; per axis
SIZE_ERROR = 0.03  # relative error of an object's size predicted from the last frame
_EDGE_PX = 0.3  # standard deviation of a mask's edge
_MIN_VISIBLE = 0.25  # share of a disc's area from which the disc is fitted
_MIN_EDGE_PX = 12  # pixels of the edge from which the disc is fitted
_MIN_ON_DISC = 0.5  # share of the edge that lies on the disc
_SMALLEST_BOX_PX = 4  # side of a box that holds an object
_STRIP = 64  # rows whose weights are computed together
_ROUND = 1.12  # ratio of a disc's sides, and of its area to that of its box's ellipse
_ROUNDS = 3  # of fits to a visible edge
VISIBLE_EDGE_PX = 0.25  # systematic error of a fitted edge
_MIN_VISIBLE_EDGE = 0.25  # share of an edge
_REACH_PX = 4.0  # distance to both sides of an edge at which the inner and the outer colour are sampled
_SAMPLE_PX = 0.5  # between the samples across an edge
_MIN_CONTRAST = 20.0  # between the inner and the outer colour, grey levels
_CIRCLE_POINTS = 48
_DISC_ERROR = 0.15  # relative error of a partly hidden disc's predicted radius and centre
_TUKEY = 4.685  # robust standard deviations
_HIDDEN = 0.7  # hidden share of an object, relative to the share of its edge that borders on foreground
_HIDDEN_AT_BORDER = 0.3  # assumed hidden share of an object at the image's border


@dataclass(frozen=True)
class Coverage:
    """Share `alpha` (h, w) of each pixel in `box` of the image that the object covers, and its `variance` (h, w), 0
    where the share is certain; standard deviation of the edge's blur, px, up to 40 % too small where it is strong."""

    alpha: NDArray[np.float32]
    variance: NDArray[np.float32]
    box: Box
    blur_px: float = 0.0


@dataclass(frozen=True)
class Outline:
    """An object's outline in one image.

    Attributes:
        center_px: (2,).
        cov_px: (2, 2) covariance of `center_px`, px².
        angular_radius_rad: Angular radius.
        angular_radius_var: Its variance, rad².
        box_px: Bounding box (x, y, width, height).
        area_px: Area.
        is_partial: A part of the object is hidden or cut off by the image's border.
        harmonics: Second and third of the edge (cos, sin, cos, sin) over the radius.
        non_circularity: Relative excess of the second moment over a disc's, of the pixels that are covered by half.
        is_cut: The image's border cuts it off.
        is_edge: It is partial, and its visible edge was fitted.
        hidden_px: Standard deviation of the centre's coordinates by what of the object may be hidden beyond it.
        blur_px: Standard deviation of its edge's blur, up to 40 % too small where it is strong.
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
    is_cut: bool = False
    is_edge: bool = False
    hidden_px: float = 0.0
    blur_px: float = 0.0

    @property
    def is_disc(self) -> bool:
        """Whether the box is as wide as high, and filled as by a disc."""
        _, _, w, h = self.box_px
        return max(w, h) < _ROUND * min(w, h) and 1 / _ROUND < self.area_px / (math.pi / 4 * w * h) < _ROUND


class Optics:
    """Per-pixel weights of one camera, computed beside the first frames in another thread (0.3 s for 1280×720)."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        thread = ThreadPoolExecutor(1, "optics")
        self._computed = thread.submit(_weights, camera)
        thread.shutdown(wait=False)

    @cached_property
    def weights(self) -> Map:
        """(3, h, w) solid angle times viewing direction, sr."""
        return self._computed.result()


def _weights(camera: Camera) -> Map:
    """`Optics.weights`."""
    weights = np.empty((3, camera.height, camera.width), np.float32)
    for top in range(0, camera.height, _STRIP):  # whole maps of directions would take three times as much memory
        first = max(top - 1, 0)
        bearings = camera.bearing_map(first, min(top + _STRIP + 1, camera.height))
        rows = np.s_[top - first : top - first + _STRIP]
        angles = solid_angles(bearings)[rows]
        weights[:, top : top + _STRIP] = np.moveaxis(bearings[rows] * angles[..., None], -1, 0)
    return weights


def outline_in_box(image: Image, box_px: Sequence[float], optics: Optics) -> Outline:
    """Return the outline of an ellipse that fills a box x, y, width, height; InputError for a box that is not inside
    the image."""
    x, y, w, h = box_px
    height, width = image.shape[:2]
    if not (x >= 0 and y >= 0 and w >= _SMALLEST_BOX_PX <= h and x + w <= width and y + h <= height):
        expected = f"X Y W H of at least {_SMALLEST_BOX_PX} pixels a side, within {width}×{height}"
        raise InputError("track", f"the object's box {x:g} {y:g} {w:g} {h:g}; expected {expected}")
    box = int(x), int(y), math.ceil(x + w), math.ceil(y + h)
    mask = masks.ellipse(box, np.array([x + (w - 1) / 2, y + (h - 1) / 2]), w, h)
    shape = fit_outline(image, mask, box, optics)
    if shape is None:
        raise InputError("track", f"the object's box {x:g} {y:g} {w:g} {h:g} holds no outline; expected a larger one")
    return shape


def fit_outline(
    image: Image,
    mask: Mask,
    box: Box,
    optics: Optics,
    expected_area_px: float | None = None,
) -> Outline | None:
    """Return the outline of a hard mask (h, w) of the region `box` of an RGB image; None if nothing is covered.

    If the image's border cuts the object off, or the mask is smaller than the expected area and no disc, a disc of the
    expected area is fitted to the visible edge.  If the fit fails, the covariance grows by the possible distance
    between the centres of the visible part and of the object.
    """
    shape = outline(cover(image, mask, box), optics)
    if shape is None:
        return None
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


def beside_foreground(outline: Outline, share: float) -> Outline:
    """The outline of a non-disc of whose edge a share borders on foreground, behind which more of it may be."""
    return replace(outline, hidden_px=_HIDDEN * share * _OFF_CENTER * math.sqrt(outline.area_px / math.pi))


def _disc(mask: Mask, box: Box, visible: Outline, area_px: float) -> Outline | None:
    """Fit a disc of a known area (px) to the edge of a mask (h, w) of the region `box`; None if the fit fails."""
    edge = masks.contour(mask).astype(float)
    inner = (edge > 0).all(axis=1) & (edge < np.array(mask.shape)[::-1] - 1).all(axis=1)
    if visible.area_px < _MIN_VISIBLE * area_px or np.count_nonzero(inner) < _MIN_EDGE_PX:
        return None
    radius = math.sqrt(area_px / math.pi)
    x, y, uu, uv, vv, share = _fit_circle(edge[inner], radius - 0.5)  # the edge's pixels lie inside
    if share < _MIN_ON_DISC:
        return None
    center = np.array([box[0] + x, box[1] + y])
    angle = visible.angular_radius_rad * math.sqrt(area_px / visible.area_px)
    return Outline(
        center_px=center,
        cov_px=np.array(((uu, uv), (uv, vv))),
        angular_radius_rad=angle,
        angular_radius_var=(SIZE_ERROR * angle) ** 2,
        box_px=(center[0] - radius, center[1] - radius, 2 * radius, 2 * radius),
        area_px=area_px,
        is_partial=True,
    )


@njit(cache=True, error_model="numpy")
def _fit_circle(edge: Array, radius: float) -> tuple[float, float, float, float, float, float]:
    """Fit a circle of a known radius to edge points (n, 2), in order along the edge.

    The circle through two points with most votes (points on it minus points outside) is refined by Gauss–Newton steps
    (Nᵀ N) δ = Nᵀ d, with the unit normals N and the distances d of the points near it.

    Returns:
        Centre x, y, its covariance uu, uv, vv, and votes as a share of the points (0 if the fit is degenerate).
    """
    n = len(edge)
    limit = max(1.0, SIZE_ERROR * radius)
    most_votes = 0
    x = 0.0
    y = 0.0
    for i in range(0, n, max(n // 24, 1)):
        for separation in (n // 8, n // 4, n // 2):
            dx = edge[(i + separation) % n, 0] - edge[i, 0]
            dy = edge[(i + separation) % n, 1] - edge[i, 1]
            chord2 = dx * dx + dy * dy
            if chord2 > 4 * radius**2:
                continue
            height = math.sqrt((radius**2 - 0.25 * chord2) / chord2)
            for side in (-height, height):
                u = edge[i, 0] + 0.5 * dx - side * dy
                v = edge[i, 1] + 0.5 * dy + side * dx
                votes = 0
                for k in range(n):
                    distance = math.hypot(edge[k, 0] - u, edge[k, 1] - v) - radius
                    votes += 1 if abs(distance) < limit else -1 if distance > 0 else 0
                if votes > most_votes:
                    most_votes = votes
                    x = u
                    y = v
    inverse = np.zeros((2, 2))
    normals = np.zeros((0, 2))
    for _ in range(3):
        dx = edge[:, 0] - x
        dy = edge[:, 1] - y
        distances = np.sqrt(dx * dx + dy * dy)
        is_near = np.abs(distances - radius) < limit
        normals = np.column_stack((dx / distances, dy / distances))[is_near]
        A = normals.T @ normals
        det = A[0, 0] * A[1, 1] - A[0, 1] ** 2
        if not det > 1e-6 * (A[0, 0] + A[1, 1]) ** 2:
            return x, y, 0.0, 0.0, 0.0, 0.0
        inverse = np.array(((A[1, 1], -A[0, 1]), (-A[0, 1], A[0, 0]))) / det
        step = inverse @ (normals.T @ (distances[is_near] - radius))
        x += step[0]
        y += step[1]
    by_radius = inverse @ normals.sum(axis=0)  # ∂centre / ∂radius
    cov = _CORRELATION * _EDGE_PX**2 * inverse + (SIZE_ERROR * radius) ** 2 * np.outer(by_radius, by_radius)
    return x, y, cov[0, 0], cov[0, 1], cov[1, 1], most_votes / n


class VisibleEdge(NamedTuple):
    """Shift (2,) px from a predicted edge to the one in the image, how much farther out that is (px), and their joint
    covariance (3, 3) px²."""

    shift_px: Array
    farther_px: float
    cov: Array


def fit_visible_edge(
    image: Image, evidence: Map, foreground: Mask, box: Box, edge: Array, outward: Array, farther_std_px: float
) -> VisibleEdge | None:
    """Fit a predicted edge where it borders on background; None if too little of it does.

    Between the colours F inside and B outside, I = a F + (1 − a) B; the edge lies where the sum of a says.

    Args:
        image: RGB (H, W, 3).
        evidence: (h, w) of the region `box`, positive where it shows the object.
        foreground: (h, w) mask.
        box: Region of the image.
        edge: (m, 2) predicted edge, px.
        outward: (m, 2) its unit normals.
        farther_std_px: Prior standard deviation of `farther_px`.
    """
    solution: Array = np.zeros(3)
    cov: Array = np.eye(3)
    for _ in range(_ROUNDS):
        points = edge + solution[:2] + solution[2] * outward
        offsets, is_visible = _edge_offsets(image, evidence, foreground, box[:2], points, outward)
        if np.count_nonzero(is_visible) < _MIN_VISIBLE_EDGE * len(edge):
            return None
        step, cov = _robust_shift(offsets[is_visible], outward[is_visible], farther_std_px, -solution)
        solution = solution + step
    return VisibleEdge(solution[:2], float(solution[2]), cov + VISIBLE_EDGE_PX**2 * np.eye(3))


def fit_visible_disc(
    image: Image, evidence: Map, foreground: Mask, box: Box, outline: Outline, circle: tuple[Array, float]
) -> Outline | None:
    """The outline of a disc near a circle (centre (2,), radius; px) at its visible edge; None if that is too little.

    Args:
        outline: The visible part's.
        image, evidence, foreground, box: As for `fit_visible_edge`.
    """
    center, radius = circle
    region = evidence, foreground, box
    fit = fit_visible_edge(image, *region, center + radius * _circle(), _circle(), _DISC_ERROR * radius)
    if fit is None or not max(math.hypot(*fit.shift_px), abs(fit.farther_px)) < _DISC_ERROR * radius + 1:
        return None
    growth = radius / math.sqrt(outline.area_px / math.pi)
    angle = growth * outline.angular_radius_rad
    x, y = center.tolist()
    disc_px = x - radius, y - radius, 2 * radius, 2 * radius
    whole = replace(outline, center_px=center, angular_radius_rad=angle, box_px=disc_px, area_px=math.pi * radius**2)
    return at_visible_edge(whole, fit, radius)


def at_visible_edge(outline: Outline, fit: VisibleEdge, radius_px: float) -> Outline:
    """The outline moved and grown to a fitted edge."""
    growth = 1 + fit.farther_px / radius_px
    x, y = (outline.center_px + fit.shift_px).tolist()
    w, h = (growth * side for side in outline.box_px[2:])
    angle = growth * outline.angular_radius_rad
    return replace(
        outline,
        center_px=np.array([x, y]),
        cov_px=fit.cov[:2, :2],
        angular_radius_rad=angle,
        angular_radius_var=float(fit.cov[2, 2]) * (angle / (growth * radius_px)) ** 2,
        box_px=(x - w / 2, y - h / 2, w, h),
        area_px=growth**2 * outline.area_px,
        is_partial=True,
        is_edge=True,
    )


@cache
def _circle() -> Array:
    """(n, 2) points of the unit circle."""
    angles = 2 * np.pi * np.arange(_CIRCLE_POINTS) / _CIRCLE_POINTS
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


@njit(cache=True, error_model="numpy")
def _edge_offsets(
    image: Image, evidence: Map, foreground: Mask, corner: tuple[int, int], points: Array, outward: Array
) -> tuple[Array, Mask]:
    """Distance (m,) px along the normals from predicted points to the edge, and whether it is visible there (m,)."""
    m = len(points)
    offsets = np.zeros(m)
    is_visible = np.zeros(m, np.bool_)
    rows, columns = evidence.shape
    n = int(2 * _REACH_PX / _SAMPLE_PX) + 1
    colors = np.empty((n, 3))
    for i in range(m):
        inner_x, inner_y = points[i] - _REACH_PX * outward[i]
        outer_x, outer_y = points[i] + _REACH_PX * outward[i]
        u = math.floor(inner_x + 0.5) - corner[0]
        v = math.floor(inner_y + 0.5) - corner[1]
        x = math.floor(outer_x + 0.5) - corner[0]
        y = math.floor(outer_y + 0.5) - corner[1]
        if not (0 <= u < columns - 1 and 0 <= v < rows - 1 and 0 <= x < columns - 1 and 0 <= y < rows - 1):
            continue
        if min(inner_x, inner_y, outer_x, outer_y) < 0:
            continue
        if max(inner_x, outer_x) >= image.shape[1] - 1 or max(inner_y, outer_y) >= image.shape[0] - 1:
            continue
        if evidence[v, u] < 0.5 or foreground[y, x] or evidence[y, x] > 0.3:
            continue
        for k in range(n):
            t = k * _SAMPLE_PX
            _bilinear(image, inner_x + t * outward[i, 0], inner_y + t * outward[i, 1], colors[k])
        beyond = (colors[n - 1] + colors[n - 2] + colors[n - 3]) / 3
        contrast = (colors[0] + colors[1] + colors[2]) / 3 - beyond
        square = (contrast**2).sum()
        if square < _MIN_CONTRAST**2:
            continue
        total = 0.5
        for k in range(1, n - 1):
            total += min(max(((colors[k] - beyond) * contrast).sum() / square, 0.0), 1.0)
        offsets[i] = _SAMPLE_PX * total - _REACH_PX
        is_visible[i] = True
    return offsets, is_visible


@njit(cache=True, error_model="numpy")
def _bilinear(image: Image, x: float, y: float, color: Array) -> None:
    """Set `color` (3,) to that of an image at a point inside of it."""
    left = int(x)
    top = int(y)
    a = x - left
    b = y - top
    for c in range(3):
        upper = (1 - a) * image[top, left, c] + a * image[top, left + 1, c]
        lower = (1 - a) * image[top + 1, left, c] + a * image[top + 1, left + 1, c]
        color[c] = (1 - b) * upper + b * lower


@njit(cache=True, error_model="numpy")
def _robust_shift(offsets: Array, outward: Array, farther_std_px: float, prior: Array) -> tuple[Array, Array]:
    """Shift x, y and distance along the normals (3,) that explain offsets (n,) along normals (n, 2), and its covariance
    (3, 3): least squares with Tukey's weights, and a prior (3,) for the distance."""
    n = len(offsets)
    design = np.ones((n, 3))
    design[:, :2] = outward
    weights = np.ones(n)
    solution: Array = np.zeros(3)
    A = np.eye(3)
    variance = _EDGE_PX**2
    for _ in range(2 * _ROUNDS):
        weighted = design * weights.reshape(-1, 1)
        A = weighted.T @ design
        b = weighted.T @ offsets
        information = variance / farther_std_px**2
        A[2, 2] += information
        b[2] += information * prior[2]
        A += 1e-3 * np.eye(3)
        solution = np.linalg.solve(A, b)
        residual = offsets - design @ solution
        cut = max(_TUKEY * 1.4826 * np.median(np.abs(residual)), 0.5)
        for i in range(n):
            weights[i] = max(1 - (residual[i] / cut) ** 2, 0.0) ** 2
        variance = max((weights * residual**2).sum() / max(weights.sum() - 3, 1.0), 0.5 * _EDGE_PX**2)
    return solution, _CORRELATION * variance * np.linalg.inv(A)


LEVELS = np.arange(256, dtype=np.float32)
_LIGHT = np.where(LEVELS < 10.3, LEVELS / 12.92, 255 * ((LEVELS / 255 + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Light of each grey level by the tone curve of sRGB (IEC 61966-2-1)."""


def cover(image: Image, mask: Mask, box: Box) -> Coverage:
    """Return the soft coverage of a hard mask (h, w) of the region `box` of an RGB image.

    In a band around the mask's edge a pixel mixes the colours F just inside and B just outside, I = a·F + b·B.  a + b
    is near 1 but not bound to it, since the shading of a round object falls off towards its rim.  The misfit gives the
    variance.

    A blurred edge's band is as wide as its blur, and lies around the pixels that are covered by half.  There light is
    mixed, not grey levels: lens and motion blur the light, before the camera's tone curve.
    """
    area_px = np.count_nonzero(mask)
    band = _BAND_PX if area_px > _SMALL_PX else 1
    coverage = _mixed(image, mask, box, band, LEVELS)
    if coverage.blur_px < SHARP_PX:
        return coverage
    for _ in range(2):
        blur_px = coverage.blur_px
        coverage = _mixed(image, mask, box, max(math.ceil(2 * blur_px), band), _LIGHT)
        mask, box = coverage.alpha > 0.5, coverage.box
    return replace(coverage, blur_px=max(blur_px, coverage.blur_px))


def _mixed(image: Image, mask: Mask, box: Box, band: int, tones: Map) -> Coverage:
    """The soft coverage by the `tones` (256,) of the levels, which are mixed up to `band` px from the mask's edge."""
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    margin = 3 * band + 3  # in which the colours beside an edge are sampled
    left = max(x - margin, 0)
    top = max(y - margin, 0)
    part = np.s_[top : y + h + margin, left : x + w + margin]
    patch = image[box[1] : box[3], box[0] : box[2]][part].copy()
    x0 = box[0] + left
    y0 = box[1] + top
    alpha, variance, blur_px = covered(patch, mask[part].copy(), band, tones)
    return Coverage(alpha, variance, (x0, y0, x0 + patch.shape[1], y0 + patch.shape[0]), blur_px)


def outline(coverage: Coverage, optics: Optics) -> Outline | None:
    """Return the outline of a covered region; None if nothing is covered or its direction has no image."""
    camera = optics.camera
    left, top, _, _ = coverage.box
    m = moments(coverage.alpha, coverage.variance, optics.weights, left, top)
    if m.area < 1.0 or not m.box[2]:
        return None
    u, v, u_by_direction, v_by_direction = camera.project_linearised(*m.direction)
    if math.isnan(u):
        return None
    x = left + m.box[0]
    y = top + m.box[1]
    width, height = m.box[2:]
    radius, radius_var, uu, uv, vv = _covariance(
        m.cov, m.omega, m.area, camera.focal_px, u_by_direction, v_by_direction
    )
    edge_harmonics, excess = harmonics(coverage.alpha, optics.weights, left, top, m.direction, m.omega)
    is_cut = x <= 0 or y <= 0 or x + width >= camera.width or y + height >= camera.height
    return Outline(
        center_px=np.array((u, v)),
        cov_px=np.array(((uu, uv), (uv, vv))),
        angular_radius_rad=radius,
        angular_radius_var=radius_var,
        box_px=(float(x), float(y), float(width), float(height)),
        area_px=m.area,
        is_partial=is_cut,
        harmonics=edge_harmonics,
        non_circularity=excess,
        is_cut=is_cut,
        blur_px=coverage.blur_px,
    )


@njit(cache=True, error_model="numpy")
def _covariance(
    cov: Array, omega: float, area: float, focal_px: float, u_by_direction: Vector, v_by_direction: Vector
) -> tuple[float, float, float, float, float]:
    """Angular radius θ = acos(1 − Ω/2π), its variance, and the covariance uu, uv, vv of the centre's pixel, J S Jᵀ.

    S is the direction's part of `cov` (`Moments.cov`), J = ∂(u, v)/∂direction.
    """
    radius = math.acos(1 - min(omega / (2 * math.pi), 1.0))
    J = np.array((u_by_direction, v_by_direction))
    center_cov = _CORRELATION * (J @ np.ascontiguousarray(cov[:3, :3]) @ J.T) + EDGE_ERROR_PX**2 / math.sqrt(
        area / math.pi
    ) * np.eye(2)
    radius_var = _CORRELATION * cov[3, 3] / (2 * math.pi * math.sin(radius)) ** 2 + (EDGE_ERROR_PX / focal_px) ** 2
    return radius, radius_var, center_cov[0, 0], center_cov[0, 1], center_cov[1, 1]


@njit(cache=True, error_model="numpy")
def covered(patch: Image, mask: Mask, band: int, tones: Map) -> tuple[Map, Map, float]:
    """Share of each pixel (h, w) that the object covers, its variance (h, w), 0 where the share is certain, and the
    blur across the edge, px.

    At an edge it is the mean of two estimates, weighted by their inverse variances: the mixture of the colours inside
    and outside, and the hard mask, which decides where the pixel's colour is no such mixture.  The blur is the smaller
    of colours and brightness, since mosaic and compression blur the hue of sharp edges.

    Args:
        patch: (h, w, 3) RGB.
        mask: (h, w) hard mask of the object.
        band: Distance from the mask's edge, px, up to which a pixel may be partly covered.
        tones: (256,) what is mixed, by level.
    """
    height, width = mask.shape
    kind = _kinds(mask, band)
    alpha = np.zeros((height, width), np.float32)
    variance = np.zeros((height, width), np.float32)
    reach = 2 * band + 2
    all_columns = np.zeros((width, 8), np.float32)
    for y in range(height):
        _add_colors(all_columns, patch[y], kind[y], tones, 1)
    whole = all_columns.sum(axis=0)
    columns = np.zeros((width, 8), np.float32)  # sums of the rows within reach
    sums = np.zeros((width + 1, 8), np.float32)  # cumulated over the columns
    mixed = 0.0  # ∫a (1 − a)
    luma_mixed = 0.0  # the same of the brightness, and the edge's length, both times its contrast²
    luma_length = 0.0
    window = np.empty(8, np.float32)
    for y in range(-reach, height):
        if y + reach < height:
            _add_colors(columns, patch[y + reach], kind[y + reach], tones, 1)
        if y > reach:
            _add_colors(columns, patch[y - reach - 1], kind[y - reach - 1], tones, -1)
        if y < 0:
            continue
        for x in range(width):
            for channel in range(8):
                sums[x + 1, channel] = sums[x, channel] + columns[x, channel]
        for x in range(width):
            if kind[y, x] == _INNER:
                alpha[y, x] = 1
            elif kind[y, x] == _EDGE:
                left = max(x - reach, 0)
                right = min(x + reach + 1, width)
                for channel in range(8):
                    window[channel] = sums[right, channel] - sums[left, channel]
                color = (float(tones[patch[y, x, 0]]), float(tones[patch[y, x, 1]]), float(tones[patch[y, x, 2]]))
                inner = _mean(window if window[3] else whole, 0)
                outer = _mean(window if window[7] else whole, 4)
                a, b, residual2, contrast2 = _unmixed(color, inner, outer)
                noise = residual2 / 3 + _LEVEL_VAR  # variance of the mixture: noise / contrast2
                signal = _MASK_VAR * contrast2
                weight = signal / (noise + signal)
                alpha[y, x] = weight * a / max(a + b, 1e-6) + (1 - weight) * mask[y, x]
                variance[y, x] = noise * _MASK_VAR / (noise + signal)
                above = _luma(color) - _luma(outer)
                below = _luma(inner) - _luma(color)
                mixed += alpha[y, x] * (1 - alpha[y, x])
                luma_mixed += max(above * below, 0.0)
                luma_length += (above + below) ** 2 / (2 * band)
    length = math.sqrt(4 * math.pi * max(mask.sum(), 1))  # of a disc
    return alpha, variance, _TO_BLUR * min(mixed / length, luma_mixed / max(luma_length, 1e-9))


@njit(cache=True, error_model="numpy")
def _kinds(mask: Mask, band: int) -> NDArray[np.uint8]:
    """(h, w) `_INNER` where all pixels within `band` px are marked, `_OUTER` where none is, else `_EDGE`.  If no pixel
    is inner, all marked pixels are."""
    height, width = mask.shape
    kind = np.empty((height, width), np.uint8)
    inner = 0
    whole = (2 * band + 1) ** 2
    columns = np.zeros(width + 2 * band, np.uint8)  # marked pixels of each column, of the rows within the band
    count = np.empty(width, np.uint8)
    for y in range(-2 * band, height):
        entering = mask[min(max(y + band, 0), height - 1)]
        leaving = mask[max(y - band - 1, 0)]
        within = columns[band : band + width]
        for x in range(width):
            within[x] += entering[x]
        if y > 0:
            for x in range(width):
                within[x] -= leaving[x]
        if y < 0:
            continue
        for k in range(band):
            columns[k] = within[0]
            columns[band + width + k] = within[width - 1]
        for x in range(width):
            count[x] = 0
        for k in range(2 * band + 1):
            shifted = columns[k : k + width]
            for x in range(width):
                count[x] += shifted[x]
        row = kind[y]
        for x in range(width):
            row[x] = _EDGE if 0 < count[x] < whole else _OUTER if count[x] == 0 else _INNER
            inner += count[x] == whole
    if inner == 0:
        for y in range(height):
            for x in range(width):
                if mask[y, x]:
                    kind[y, x] = _INNER
    return kind


@njit(cache=True, error_model="numpy")
def _add_colors(columns: Map, row: Image, kind: NDArray[np.uint8], tones: Map, times: int) -> None:
    """Add a row (w, 3) of pixels to the sums of the `columns` (w, 8) in place: red, green, blue and number of the inner
    pixels, then of the outer pixels."""
    for x in range(len(row)):
        if kind[x] != _EDGE:
            first = 0 if kind[x] == _INNER else 4
            for channel in range(3):
                columns[x, first + channel] += times * tones[row[x, channel]]
            columns[x, first + 3] += times


@njit(cache=True, error_model="numpy")
def _luma(color: Color) -> float:
    return _LUMA[0] * color[0] + _LUMA[1] * color[1] + _LUMA[2] * color[2]


@njit(cache=True, error_model="numpy")
def _mean(sums: Map, first: int) -> Color:
    share = 1 / max(sums[first + 3], 1)
    return sums[first] * share, sums[first + 1] * share, sums[first + 2] * share


@njit(cache=True, error_model="numpy")
def _unmixed(pixel: Color, inner: Color, outer: Color) -> tuple[float, float, float, float]:
    """Shares a, b of the inner colour F and the outer colour B in a pixel's colour I: least squares of I = a F + b B.

    A fourth channel, `UNIT` in all three, weighs the condition a + b = 1.

    Returns:
        a, b, the squared residual |I − a F − b B|², and |F − B|².
    """
    i0, i1, i2 = pixel
    f0, f1, f2 = inner
    b0, b1, b2 = outer
    unit2 = UNIT * UNIT
    ff = f0 * f0 + f1 * f1 + f2 * f2 + unit2
    bb = b0 * b0 + b1 * b1 + b2 * b2 + unit2
    fb = f0 * b0 + f1 * b1 + f2 * b2 + unit2
    fi = f0 * i0 + f1 * i1 + f2 * i2 + unit2
    bi = b0 * i0 + b1 * i1 + b2 * i2 + unit2
    det = max(ff * bb - fb * fb, _MIN_DET)  # Cramer's rule
    a = max(bb * fi - fb * bi, 0.0) / det
    b = max(ff * bi - fb * fi, 0.0) / det
    residual2 = (i0 - a * f0 - b * b0) ** 2 + (i1 - a * f1 - b * b1) ** 2 + (i2 - a * f2 - b * b2) ** 2
    return a, b, residual2, ff + bb - 2 * fb


class Moments(NamedTuple):
    """Sums over the covered pixels."""

    direction: Color  # (3,) viewing direction times solid angle
    omega: float  # solid angle, sr
    cov: Array  # (4, 4) covariance of `direction` and `omega` for independent pixel errors
    area: float  # px
    box: tuple[int, int, int, int]  # x, y, width, height of the pixels that are covered by more than half


@njit(cache=True, error_model="numpy")
def moments(alpha: Map, variance: Map, weights: Map, left: int, top: int) -> Moments:
    """Return the moments of a region (h, w) of the image with its corner at `left`, `top`.

    Args:
        alpha, variance: (h, w) as from `covered`.
        weights: (3, height, width) each pixel's solid angle times its direction.
    """
    height, width = alpha.shape
    area = 0.0
    sums = np.zeros(4)
    cov = np.zeros((4, 4))
    pixel = np.empty(4)  # weights, and their length, the solid angle
    x0 = width
    y0 = height
    x1 = y1 = 0
    for row in range(height):
        for column in range(width):
            share = float(alpha[row, column])
            var = float(variance[row, column])
            if share == 0 and var == 0:
                continue
            area += share
            for i in range(3):
                pixel[i] = weights[i, top + row, left + column]
            pixel[3] = math.sqrt(pixel[0] ** 2 + pixel[1] ** 2 + pixel[2] ** 2)
            for i in range(4):
                sums[i] += share * pixel[i]
                for j in range(4):
                    cov[i, j] += var * pixel[i] * pixel[j]
            if share > 0.5:
                x0 = min(x0, column)
                x1 = max(x1, column + 1)
                y0 = min(y0, row)
                y1 = max(y1, row + 1)
    direction = (sums[0], sums[1], sums[2])
    return Moments(direction, sums[3], cov, area, (x0, y0, max(x1 - x0, 0), max(y1 - y0, 0)))


@njit(cache=True, error_model="numpy")
def harmonics(
    alpha: Map, weights: Map, left: int, top: int, axis: Color, omega: float
) -> tuple[tuple[float, float, float, float], float]:
    """Return the second and third harmonic of an outline's edge and its non-circularity, as `Outline` has them.

    They are computed in the tangent plane of `axis`, the mean direction, in which a ball's image is a disc.  An edge at
    r(1 + ε cos kθ) has the moment ∫ρᵏ cos kθ dA = ε π r^(k + 2).  Blur hardly moves where a pixel is covered by half.

    Args:
        alpha, weights, left, top: As for `moments`.
        axis, omega: Direction and solid angle of its result.
    """
    length = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    p = axis[0] / length
    q = axis[1] / length
    r = axis[2] / length
    side = math.sqrt(p * p + r * r)
    ex = r / side  # e = (ex, 0, ez) and f = axis × e span the plane
    ez = -p / side
    fx = q * ez
    fy = r * ex - p * ez
    fz = -q * ex
    c2 = s2 = c3 = s3 = area = second = 0.0
    for row in range(len(alpha)):
        for column in range(alpha.shape[1]):
            if alpha[row, column] == 0:
                continue
            a = float(weights[0, top + row, left + column])
            b = float(weights[1, top + row, left + column])
            c = float(weights[2, top + row, left + column])
            d = math.sqrt(a * a + b * b + c * c)
            x = (ex * a + ez * c) / d
            y = (fx * a + fy * b + fz * c) / d
            w = float(alpha[row, column]) * d
            c2 += w * (x * x - y * y)
            s2 += w * 2 * x * y
            c3 += w * x * (x * x - 3 * y * y)
            s3 += w * y * (3 * x * x - y * y)
            if alpha[row, column] >= 0.5:
                area += d
                second += d * (x * x + y * y)
    square = omega * omega / math.pi  # π r⁴
    cube = square * math.sqrt(omega / math.pi)
    excess = 2 * math.pi * second / area**2 - 1 if area else 0.0
    return (c2 / square, s2 / square, c3 / cube, s3 / cube), excess
