"""Particle filter over whole objects: a particle is a position and a radius, and each image says how well it fits (R).

    sample from the prediction → weigh → (resample, disperse, weigh more sharply) … → weighted mean

A particle's image is the object's template: points within the object, which should show it, and points around it, which
should not.  An object that is half hidden by a hand that moves with it is thus located by the part that is visible.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import View
from pps_vision.geometry.masks import Box
from pps_vision.jit import njit
from pps_vision.types import Array, Mask

Map = NDArray[np.float32]
_INSIDE = 150  # points of a template within the object, about
_DISPERSION = 0.5  # variance by which particles are dispersed between layers, relative to theirs
_EDGE = 48  # points of a template along the object's edge, about
BESIDE_PX = 1.5  # distance from the edge at which the image is compared
_TANGENT = 3  # contour pixels to both sides that give its direction
_BISECTIONS = 7
_LEAST_INFORMATION = 0.05  # information of the images along an axis, relative to the prediction's
_FARTHEST = 4.0  # standard deviations of the prediction: no particle is farther


@dataclass(frozen=True)
class ParticleFilterParams:
    """Parameters of the particle filter."""

    count: int = 120
    """Number of particles."""
    layers: int = 6
    """Largest number of annealing layers (Deutscher 2000), whose exponent of the likelihood rises to 1."""
    least_effective: float = 0.3
    """Effective share of the particles in each layer: the smaller, the fewer layers."""
    sharpness: float = 30.0
    """Log-likelihood ratio of an image that shows the whole object and one that shows none of it."""
    radius_std: tuple[float, float] = (0.05, 0.01)
    """Relative standard deviation of the radius, before and after the object was wholly visible for some time."""

    def __post_init__(self) -> None:
        if not (self.count >= 2 and self.layers >= 1 and self.sharpness > 0 and min(self.radius_std) > 0):
            raise InputError(
                "particle filter", f"{self}; expected 2 or more particles, 1 or more layers, positive numbers"
            )


class Template(NamedTuple):
    """Points of an object's image in the plane through its centre across the line of sight, in units of its radius."""

    inside: Array  # (n, 2) spread over the object
    edge: Array  # (m, 2) along its edge
    outward: Array  # (m, 2) the edge's normals


class Evidence(NamedTuple):
    """Region of one image: what each pixel (h, w) says, 1 if it shows the object, -1 if it shows the background."""

    pixels: Map
    corner: tuple[int, int]  # x, y of the first pixel, px
    size: tuple[int, int]  # width and height of the image, px


class Eye(NamedTuple):
    """A camera's view, the object's offset (2,) px from where it projects to (calibration error), and the evidence."""

    view: View
    offset_px: tuple[float, float]
    template: Template
    evidence: Evidence


class Prediction(NamedTuple):
    """Predicted position (3,) m with its covariance (3, 3) m², and radius (m) with its relative standard deviation."""

    p_root: Array
    cov_root: Array
    radius_m: float
    radius_std: float = 0.01


class Located(NamedTuple):
    """Weighted mean of the particles and its covariance; the position that the images alone tell, and its covariance
    (without the prediction, which they were sampled from); the radius, and its relative standard deviation before; the
    mean score of the images; and of each eye the visible share of the object, and its edge (m, 2) px with normals."""

    p_root: Array
    cov_root: Array
    measured: Array
    measured_cov: Array
    radius_m: float
    radius_std: float
    score: float
    fill: tuple[float, ...]
    edges: tuple[tuple[Array, Array], ...]


def locate(
    params: ParticleFilterParams, prediction: Prediction, eyes: Sequence[Eye], rng: np.random.Generator
) -> Located:
    """Return where the object is."""
    projections = [_Projection(eye, prediction) for eye in eyes]
    spread = np.linalg.cholesky(prediction.cov_root)

    def score(x: Array) -> Array:
        positions = prediction.p_root + x[:, :3] @ spread.T
        by_eye = [projection.scores(positions, prediction.radius_std * x[:, 3])[0] for projection in projections]
        return np.asarray(np.sum(by_eye, axis=0))

    mean, cov = posterior(params, 4, score, rng)
    p_root = prediction.p_root + spread @ mean[:3]
    log_radius = prediction.radius_std * float(mean[3])
    at_mean = [projection.scores(p_root[None], np.array([log_radius])) for projection in projections]
    measured, measured_cov = _without_prediction(mean[:3], cov[:3, :3])
    radius_m = prediction.radius_m * math.exp(log_radius)
    return Located(
        p_root,
        spread @ cov[:3, :3] @ spread.T,
        prediction.p_root + spread @ measured,
        spread @ measured_cov @ spread.T,
        radius_m,
        prediction.radius_std,
        float(np.mean([score[0] for score, _ in at_mean])),
        tuple(float(fill[0]) for _, fill in at_mean),
        tuple(_edge(eye, p_root, radius_m) for eye in eyes),
    )


def _edge(eye: Eye, p_root: Array, radius_m: float) -> tuple[Array, Array]:
    """(m, 2) px edge of an object in an image, and its (m, 2) normals."""
    _, inner, outer = _Projection(eye, Prediction(p_root, np.eye(3), radius_m)).points
    outward = (outer - inner) / np.maximum(np.linalg.norm(outer - inner, axis=1, keepdims=True), 1e-9)
    return eye.view.project(p_root) + eye.offset_px + 0.5 * (inner + outer), outward


def posterior(
    params: ParticleFilterParams, dimensions: int, score: Callable[[Array], Array], rng: np.random.Generator
) -> tuple[Array, Array]:
    """Mean (d,) and covariance (d, d) of particles (n, d), a priori standard normal, weighed by their scores (n,)."""
    n = params.count
    x = rng.standard_normal((n, dimensions))
    log = params.sharpness * score(x)
    exponent = 0.0
    for _ in range(params.layers):
        share, weights = _annealed((1 - exponent) * log, params.least_effective * n)
        exponent += share * (1 - exponent)
        mean = weights @ x
        cov = (weights[:, None] * (x - mean)).T @ (x - mean) / (1 - min(float(weights @ weights), 0.5))
        cov += 1e-6 * np.eye(dimensions)
        if share == 1:
            break
        survivors = _resampled(weights, rng)
        x, log = x[survivors], log[survivors]
        # a Metropolis step, which does not change their density
        moved = x + rng.standard_normal(x.shape) @ np.linalg.cholesky(_DISPERSION * cov).T
        log_moved = params.sharpness * score(moved)
        gain = exponent * (log_moved - log) + 0.5 * (np.sum(x**2, axis=1) - np.sum(moved**2, axis=1))
        accepted = np.log(rng.random(n)) < gain
        x[accepted], log[accepted] = moved[accepted], log_moved[accepted]
    return mean, cov


def _annealed(log: Array, least_effective: float) -> tuple[float, Array]:
    """The largest exponent of a likelihood, up to 1, with an effective number of particles of `least_effective`, and
    the weights (n,), for the logarithms `log` (n,) of the likelihood."""
    exponent = 1.0
    low = 0.0
    high = 1.0
    for _ in range(_BISECTIONS):
        weights = np.exp(exponent * (log - log.max()))
        weights /= weights.sum()
        if 1 / float(weights @ weights) >= least_effective:
            low = exponent
        else:
            high = exponent
        if low == 1:
            break
        exponent = 0.5 * (low + high)
    return exponent, weights


def _without_prediction(mean: Array, cov: Array) -> tuple[Array, Array]:
    """Mean (3,) and covariance (3, 3) of the likelihood whose product with a standard normal distribution has these."""
    variances, axes = np.linalg.eigh(cov)
    information = np.maximum(1 / variances - 1, _LEAST_INFORMATION)
    along = np.clip((axes.T @ mean) / variances / information, -_FARTHEST, _FARTHEST)
    return axes @ along, axes @ np.diag(1 / information) @ axes.T


class _Projection:
    """Projects particles near the prediction: the template once, exactly, and for each particle shifted and scaled."""

    def __init__(self, eye: Eye, prediction: Prediction) -> None:
        self._eye = eye
        p = prediction.p_root
        self._distance_m = math.dist(p, eye.view.place)
        axes = across(eye.view, p) * rim_radius(prediction.radius_m, self._distance_m)
        center_px = eye.view.project(p)
        template = eye.template
        on_plane = template.inside, template.edge, template.edge + 0.1 * template.outward
        inside, edge, beyond = (eye.view.project(p + points @ axes) - center_px for points in on_plane)
        outward = beyond - edge
        outward *= BESIDE_PX / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
        contiguous = np.ascontiguousarray
        self.points = contiguous(inside), contiguous(edge - outward), contiguous(edge + outward)

    def scores(self, positions: Array, growth: Array) -> tuple[Array, Array]:
        """Scores (n,) of particles at positions (n, 3) whose radius has grown (log, n), and visible shares (n,)."""
        eye = self._eye
        centers = eye.view.project(positions) + eye.offset_px
        distances = np.linalg.norm(positions - eye.view.center, axis=1)
        scales = np.exp(growth) * self._distance_m / distances
        evidence = eye.evidence
        return scores(evidence.pixels, evidence.corner, evidence.size, self.points, centers, scales)


def across(view: View, p_root: Array) -> Array:
    """(2, 3) unit vectors across the line of sight to a point (3,): to the right and down in the image."""
    sight = p_root - view.center
    sight = sight / np.linalg.norm(sight)
    right = view.T_root_camera[:3, 0] - (view.T_root_camera[:3, 0] @ sight) * sight
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(sight, right)])


def rim_radius(radius_m: float, distance_m: float) -> float:
    """Radius (m) of the circle in which a ball's outline cuts the plane through its centre across the line of sight."""
    return radius_m / math.sqrt(max(1 - (radius_m / distance_m) ** 2, 0.01))


@cache
def disc() -> Template:
    """Template of a ball."""
    k = np.arange(_INSIDE)
    radius = np.sqrt((k + 0.5) / _INSIDE)
    angle = math.pi * (3 - math.sqrt(5)) * k  # Vogel's spiral
    inside = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    angle = 2 * math.pi * np.arange(_EDGE) / _EDGE
    edge = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return Template(inside, edge, edge)


class Silhouette(NamedTuple):
    """Mask (h, w) of the region `box` of an image, of an object at `p_root` (3,), seen at `center_px` (2,)."""

    mask: Mask
    box: Box
    view: View
    p_root: Array
    center_px: Array
    radius_m: float

    @property
    def angle_rad(self) -> float:
        """The object's angular radius."""
        return math.asin(min(self.radius_m / math.dist(self.p_root, self.view.place), 0.9))


def template_of(silhouette: Silhouette | None) -> Template:
    """Template of an object; None: a ball's."""
    if silhouette is None:
        return disc()
    mask, box, view, p_root, center_px, radius_m = silhouette
    distance_m = math.dist(p_root, view.place)
    axes = across(view, p_root) * rim_radius(radius_m, distance_m)
    to_plane = np.linalg.inv(view.project_jacobian(p_root) @ axes.T).T
    corner = np.array(box[:2]) - center_px
    contour = masks.contour(mask).astype(float)
    along = np.roll(contour, -_TANGENT, axis=0) - np.roll(contour, _TANGENT, axis=0)
    outward = np.stack([-along[:, 1], along[:, 0]], axis=-1)  # OpenCV's contours run counterclockwise, y down
    chosen = np.arange(0, len(contour), max(len(contour) // _EDGE, 1))
    edge = (contour + corner)[chosen] @ to_plane
    normal = outward[chosen] @ to_plane
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return Template((_thinned(mask, _INSIDE) + corner) @ to_plane, edge, normal)


def _thinned(mask: Mask, n: int) -> Array:
    """(about n, 2) pixels x, y of a mask on a square grid."""
    step = max(int(math.sqrt(np.count_nonzero(mask) / n)), 1)
    rows, columns = np.nonzero(mask[::step, ::step])
    return np.stack([columns * step, rows * step], axis=-1).astype(float)


@njit(cache=True, error_model="numpy")
def scores(
    pixels: Map,
    corner: tuple[int, int],
    size: tuple[int, int],
    points: tuple[Array, Array, Array],
    centers: Array,
    scales: Array,
) -> tuple[Array, Array]:
    """Scores (n,) of a template at `centers` (n, 2) px, scaled by `scales` (n,), and the visible shares (n,).

    `points` (m, 2) px lie inside the object, just inside its edge, and just outside.  The score is the mean evidence
    inside, plus the share of the edge where only the inner side shows the object, minus that where the outer side does.
    Points beyond the image do not count, but a quarter of all always does; those beyond the region (h, w), whose first
    pixel is `corner`, say nothing.
    """
    inside, inner, outer = points
    n = len(centers)
    score = np.zeros(n)
    fill = np.zeros(n)
    for i in range(n):
        k = scales[i]
        u = centers[i, 0] - corner[0] + 0.5
        v = centers[i, 1] - corner[1] + 0.5
        total = 0.0
        shown = 0
        counted = 0
        for j in range(len(inside)):
            value, is_in_image = _value(pixels, corner, size, u + k * inside[j, 0], v + k * inside[j, 1])
            total += value
            shown += value > 0
            counted += is_in_image
        counted = max(counted, len(inside) // 4, 1)
        fill[i] = shown / counted
        edge = 0.0
        edges = 0
        for j in range(len(inner)):
            within, _ = _value(pixels, corner, size, u + k * inner[j, 0], v + k * inner[j, 1])
            beyond, is_in_image = _value(pixels, corner, size, u + k * outer[j, 0], v + k * outer[j, 1])
            beyond = max(beyond, 0.0)
            edge += max(within, 0.0) * (1 - beyond) - beyond
            edges += is_in_image
        score[i] = total / counted + edge / max(edges, len(inner) // 4, 1)
    return score, fill


@njit(cache=True, error_model="numpy")
def _value(pixels: Map, corner: tuple[int, int], size: tuple[int, int], u: float, v: float) -> tuple[float, bool]:
    """Evidence at a point of the region, 0 beyond it, and whether the point is in the image."""
    x = math.floor(u)
    y = math.floor(v)
    value = float(pixels[y, x]) if 0 <= y < pixels.shape[0] and 0 <= x < pixels.shape[1] else 0.0
    return value, 0 <= x + corner[0] < size[0] and 0 <= y + corner[1] < size[1]


def _resampled(weights: Array, rng: np.random.Generator) -> NDArray[np.intp]:
    """(n,) indices drawn in proportion to the weights (systematic resampling)."""
    n = len(weights)
    positions = (rng.random() + np.arange(n)) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), positions), n - 1)
