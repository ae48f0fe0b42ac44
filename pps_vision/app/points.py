"""Image points of other detectors: their noise, judged by the epipolar residuals, and the filter that follows one.

A detector states a likelihood or a covariance, or nothing.  Points of similar likelihood form a group g.  Each group's
variance θ_g, px² (with a covariance: its scale), is the one that explains the epipolar residuals of both cameras:

    e = c / √(a_l + a_r)    E[e²] = (a_l θ_g(l) + a_r θ_g(r)) / (a_l + a_r)    a = ∇c C ∇cᵀ

c is the epipolar constraint, ∇c its gradient by a camera's pixel, C the stated covariance or the unit matrix.  The part
of the residuals that does not change from image to image is a correlated error, as that of a calibration.

The filter is that of the tracker.  All points are known beforehand: whether one outside the gate is an outlier or a
jump of the motion is judged by the next points.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pps_vision.app.results import Reprojection
from pps_vision.errors import InputError, expect_positive
from pps_vision.geometry.camera import StereoView, View
from pps_vision.geometry.compiled import triangulated_points
from pps_vision.types import Array, Mask
from tracking import kalman
from tracking.kalman import Belief, KalmanParams
from tracking.smoother import FilterStep

_STEP_PX = 0.01  # of numerical derivatives
_MIN_VAR_PX2 = 0.005**2  # covariances stay regular
_ITERATIONS = 100
_MEDIAN_CHI2 = 0.4549  # median of χ² with one degree of freedom
_DIMENSIONS = 3
_CHI2_95 = 5.991464547107979  # 95 % of the chi-square distribution with 2 degrees of freedom
_QUANTILE_95 = 4.0  # the 95 % quantile of F(3, n) is that of χ²(3) / 3 times about 1 + 4/n


@dataclass(frozen=True)
class PointParams:
    """Gates, groups and filter.  Chosen on simulated points (seeds 100 to 102) and the noise-free flights of tt3d."""

    kalman: KalmanParams = field(default_factory=KalmanParams)
    """Kalman filter, for an object at 0.4 m."""
    gate_sigma: float = 3.5
    """Width of the epipolar gate in standard deviations of the residual."""
    noise_gate_sigma: float = 4.5
    """The same for the residuals of which the noise is estimated: heavy tails belong to it, outliers do not."""
    tail: float = 10.0
    """Degrees of freedom of a t distribution: the covariance of an improbable measurement grows by (tail + NIS) /
    (tail + 3), as in EM for t-distributed noise; inf: none does."""
    groups: int = 5
    """Largest number of groups by likelihood."""
    group_pairs: int = 100
    """Number of pairs for each further group."""
    lookahead: int = 2
    """Number of later measurements by which an outlier is told from a jump of the motion."""
    calm_chi2: float = 14.0
    """NIS above which the motion may have turned or jumped."""
    outlier_chi2: float = 14.0
    """−2 times the log-likelihood ratio of an outlier and a jump of the motion to the same place (8 and 26 do about as
    well)."""
    lost_after_s: float = 0.5
    """A point that was not measured for this long is unknown."""
    aspect_rad: float = 0.6
    """As of `TrackerParams`."""

    def __post_init__(self) -> None:
        expect_positive("points", self)


class Noise(NamedTuple):
    """Noise of the points: upper likelihoods of all groups but the last (k − 1,), standard deviation of each group (k,)
    px (with stated covariances: their factor), the share of the variance that is correlated from image to image, and
    the number of residuals inside the gate out of `pairs`."""

    likelihoods: Array
    std: Array
    correlated_share: float
    inside: int
    pairs: int

    def var_of(self, likelihood: Array) -> Array:
        """Variance of points by their likelihood (NaN: not stated), in the same shape."""
        return self.std[np.searchsorted(self.likelihoods, likelihood)] ** 2


class Pairs(NamedTuple):
    """Points of one name in both images, a row for each pair; NaN where a camera did not find it."""

    pixels: Array  # (n, 2, 2) of the left and the right camera
    likelihood: Array  # (n, 2)
    cov_px2: Array  # (n, 2, 2, 2) as stated, else the unit matrix


class Positions(NamedTuple):
    """Triangulated points of one name: positions (n, 3) m, covariances (n, 3, 3) m², RMS reprojection errors (n,) px,
    NaN where there is none or it is outside the epipolar gate, and the covariances (n, 2, 2, 2) px² of the pixels."""

    position: Array
    cov: Array
    residual_px: Array
    cov_px2: Array
    is_gated: Mask  # (n,) whether both cameras found it, outside the epipolar gate


def estimate_noise(params: PointParams, view: StereoView, points: Sequence[Pairs]) -> Noise:
    """Return the noise of all points, judged together; InputError without a pair."""
    parts = [epipolar_residuals(view, item) for item in points]
    e2 = np.concatenate([part[0] for part in parts]) ** 2
    weight = np.concatenate([part[1] for part in parts])
    likelihood = np.concatenate([item.likelihood for item in points])
    is_pair = np.isfinite(e2)
    n = int(is_pair.sum())
    if n == 0:
        raise InputError("points", "no point is in both images at one time; expected names and times that both share")
    e2, weight, likelihood = e2[is_pair], weight[is_pair], likelihood[is_pair]
    stated = likelihood[np.isfinite(likelihood)]
    k = min(params.groups, 1 + n // params.group_pairs)
    edges = np.unique(np.quantile(stated, np.arange(1, k) / k)) if len(stated) else np.zeros(0)
    if len(stated):
        edges = edges[edges < stated.max()]
    if 0 < len(stated) < likelihood.size:  # NaN comes last: a group by itself
        edges = np.append(edges, np.inf)
    group = np.searchsorted(edges, likelihood)
    size = int(group.max()) + 1
    var = np.full(size, max(float(np.median(e2)) / _MEDIAN_CHI2, _MIN_VAR_PX2))
    for _ in range(_ITERATIONS):  # variance components by majorisation
        expected = np.sum(weight * var[group], axis=1)
        inside = e2 <= params.noise_gate_sigma**2 * expected
        terms = weight * (inside / expected)[:, None]
        wanted = np.bincount(group.ravel(), (terms * (e2 / expected)[:, None]).ravel(), size)
        given = np.bincount(group.ravel(), terms.ravel(), size)
        var = np.maximum(var * np.sqrt(wanted / np.maximum(given, 1e-300)), _MIN_VAR_PX2)
    counted = np.maximum(given * var, 1.0)
    noise = Noise(edges, np.sqrt(var * (1 + _QUANTILE_95 / counted)), 0.0, int(inside.sum()), n)
    return noise._replace(correlated_share=_correlated_share(params, noise, parts, points))


def _correlated_share(
    params: PointParams, noise: Noise, parts: Sequence[tuple[Array, Array]], points: Sequence[Pairs]
) -> float:
    """Share of the residuals' variance that successive images have in common, less its standard error."""
    squares = changes = 0.0
    n = 0
    for (e, weight), item in zip(parts, points, strict=True):
        z = e / np.sqrt(np.sum(weight * noise.var_of(item.likelihood), axis=1))
        z = z[np.abs(z) <= params.gate_sigma]  # False for NaN
        squares += float(np.sum(z**2)) * (len(z) > 1)
        changes += 0.5 * float(np.sum(np.diff(z) ** 2)) * len(z) / max(len(z) - 1, 1)
        n += len(z) * (len(z) > 1)
    return min(max(1 - changes / squares - n**-0.5, 0.0), 1.0) if squares > 0 else 0.0


def epipolar_residuals(view: StereoView, points: Pairs) -> tuple[Array, Array]:
    """Signed epipolar residuals e (n,) for unit variances, and the shares (n, 2) of both cameras in their variance."""
    gap = view.right.center - view.left.center
    a, a_by_pixel = _rays(view.left, points.pixels[:, 0])
    b, b_by_pixel = _rays(view.right, points.pixels[:, 1])
    gradients = (np.cross(b, gap) * a_by_pixel).sum(-1).T, (np.cross(gap, a) * b_by_pixel).sum(-1).T
    variances = np.stack(
        [np.einsum("ni,nij,nj->n", g, points.cov_px2[:, k], g) for k, g in enumerate(gradients)], axis=1
    )
    total = variances.sum(axis=1)
    return np.einsum("ni,ni->n", b, np.cross(gap, a)) / np.sqrt(total), variances / total[:, None]


def _rays(eye: View, pixels: Array) -> tuple[Array, Array]:
    """Viewing directions (n, 3) of pixels (n, 2), and their derivatives (2, n, 3) by u and v; NaN for NaN."""
    known = np.where(np.isfinite(pixels), pixels, 0.0)
    rays = eye.rays(known)
    slopes = np.stack([eye.rays(known + _STEP_PX * unit) - rays for unit in np.eye(2)]) / _STEP_PX
    return np.where(np.isfinite(pixels).all(axis=1, keepdims=True), rays, np.nan), slopes


def triangulate_points(params: PointParams, view: StereoView, points: Pairs, noise: Noise) -> Positions:
    """Return the positions of all pairs inside the epipolar gate."""
    var = noise.var_of(points.likelihood)
    cov_px2 = points.cov_px2 * var[..., None, None]
    e, weight = epipolar_residuals(view, points)
    is_pair = np.isfinite(e)
    is_inside = is_pair & (e**2 <= params.gate_sigma**2 * np.sum(weight * var, axis=1))
    flat = np.stack([cov_px2[..., 0, 0], cov_px2[..., 0, 1], cov_px2[..., 1, 1]], axis=-1).reshape(-1, 6)
    pixels = np.where(is_inside[:, None], points.pixels.reshape(-1, 4), np.nan)
    left, right = view.left, view.right
    found = triangulated_points(left.pose, left.camera.numbers, right.pose, right.camera.numbers, pixels, flat)
    return Positions(*found, cov_px2, is_pair & ~is_inside)


def follow_points(
    params: PointParams, centers: Array, stamps_s: Array, points: Positions, correlated_share: float
) -> list[FilterStep | None]:
    """Run the filter over the positions of one point at rising stamps (n,), seen from the cameras' centres (2, 3) m.

    Returns a step for each stamp, None where the point is unknown.  A position that is no outlier is that of a step
    whose belief was updated at its stamp.  `correlated_share`: of the covariances, from image to image.
    """
    known = np.flatnonzero(np.isfinite(points.position[:, 0])).tolist()
    if not known:
        return [None] * len(stamps_s)
    distance_m = float(np.median([_distance_m(centers, p) for p in points.position[known]]))
    run = _Run(params, kalman.scaled(params.kalman, distance_m), centers, stamps_s, points, correlated_share)
    steps: list[FilterStep | None] = []
    place = 0  # in `known`
    for k, stamp_s in enumerate(stamps_s.tolist()):
        is_measured = place < len(known) and known[place] == k
        place += is_measured
        ahead = known[place : place + params.lookahead]
        belief = steps[-1].belief if steps and steps[-1] else None
        if belief is not None and stamp_s - belief.updated_s > params.lost_after_s:
            belief = None
        if belief is None:
            steps.append(run.start(k, ahead) if is_measured else None)
        else:
            steps.append(run.step(belief, k, is_measured, ahead))
    return steps


class _Run(NamedTuple):
    """The filter over the positions of one point; indices count the stamps."""

    params: PointParams
    kalman: KalmanParams  # scaled to the distance
    centers: Array
    stamps_s: Array
    points: Positions
    correlated_share: float

    def measurement(self, k: int, predicted: Belief | None = None) -> tuple[Array, Array, Array]:
        """Position k, its covariance, and the correlated part.

        The covariance is that at the predicted distance: it grows with the distance's fourth power, and a far outlier
        would fit any prediction.
        """
        position, cov = self.points.position[k], self.points.cov[k]
        if predicted is not None:
            cov = (_distance_m(self.centers, predicted.mean[0]) / _distance_m(self.centers, position)) ** 4 * cov
        return position, cov, self.correlated_share * cov

    def start(self, k: int, ahead: Sequence[int]) -> FilterStep | None:
        """The first step, None if the next measurement does not fit this one."""
        position, cov, correlated = self.measurement(k)
        belief = kalman.start(self.kalman, float(self.stamps_s[k]), position, cov, correlated)
        if ahead and self.stamps_s[ahead[0]] - belief.stamp_s <= self.params.lost_after_s:
            predicted = kalman.predict(self.kalman, belief, float(self.stamps_s[ahead[0]]))
            next_one = self.measurement(ahead[0], predicted)
            if kalman.compared(self.kalman, predicted, *next_one).nis > self.params.calm_chi2:
                return None
        return FilterStep(belief, None)

    def step(self, belief: Belief, k: int, is_measured: bool, ahead: Sequence[int]) -> FilterStep:
        """The step from a belief to stamp k."""
        predicted, cross = kalman.forecast(self.kalman, belief, float(self.stamps_s[k]))
        coasted = FilterStep(predicted, (predicted, cross))
        if not is_measured:
            return coasted
        measurement = self.measurement(k, predicted)
        gated = kalman.compared(self.kalman, predicted, *measurement)
        if _DIMENSIONS < gated.nis <= self.kalman.gate_chi2:
            factor = 1 + (gated.nis - _DIMENSIONS) / (self.params.tail + _DIMENSIONS)
            position, cov, correlated = measurement
            gated = kalman.compared(self.kalman, predicted, position, factor * cov, factor * correlated)
        if gated.nis <= self.params.calm_chi2:
            return FilterStep(kalman.correct(self.kalman, gated), (predicted, cross))
        jump = kalman.compared(self.kalman, kalman.inflated(self.kalman, predicted), *measurement)
        outlier = self.params.outlier_chi2 + jump.log_det + self._cost(predicted, ahead)
        if change := kalman.gate(self.kalman, predicted, *measurement):
            other = FilterStep(kalman.correct(self.kalman, change), (change.belief, cross))
            cost = change.cost
        else:
            position, cov, correlated = self.measurement(k)
            other = FilterStep(kalman.start(self.kalman, predicted.stamp_s, position, cov, correlated), None)
            cost = self.kalman.gate_chi2 + jump.log_det
        return coasted if outlier <= cost + self._cost(other.belief, ahead) else other

    def _cost(self, belief: Belief, ahead: Sequence[int]) -> float:
        """−2 times the log-likelihood of later measurements, each of which may be a turn, a jump or an outlier."""
        cost = 0.0
        for j in ahead:
            belief = kalman.predict(self.kalman, belief, float(self.stamps_s[j]))
            measurement = self.measurement(j, belief)
            if gated := kalman.gate(self.kalman, belief, *measurement):
                cost += gated.cost
                belief = kalman.correct(self.kalman, gated)
            else:
                jump = kalman.compared(self.kalman, kalman.inflated(self.kalman, belief), *measurement)
                cost += self.params.outlier_chi2 + jump.log_det
        return cost


def _distance_m(centers: Array, p: Array) -> float:
    """Mean distance of a point (3,) from the cameras."""
    return 0.5 * (math.dist(p, centers[0]) + math.dist(p, centers[1]))


def reprojection(eye: View, steps: Sequence[FilterStep | None], pixels: Array, cov_px2: Array) -> Reprojection:
    """Reprojection errors of one camera's points, predicted by the filter from the past alone, at each of its `steps`
    that was updated and not started.

    `pixels` (n, 2) measured at the steps; `cov_px2` (n, 2, 2) of their errors that are independent from image to image.
    """
    distances_px, nis = [], []
    for k, step in enumerate(steps):
        if step is None or step.prediction is None or step.belief.updated_s != step.belief.stamp_s:
            continue
        predicted = step.prediction[0]
        u, v, of_u, of_v = eye.project_linearised(*predicted.mean[0].tolist())
        J = np.array((of_u, of_v))
        nu = pixels[k] - (u, v)
        S = J @ predicted.cov[:3, :3] @ J.T + cov_px2[k]
        distances_px.append(float(np.hypot(*nu)))
        nis.append(float(nu @ np.linalg.solve(S, nu)))
    return {
        "pairs": len(nis),
        "median_px": float(np.median(distances_px)) if nis else None,
        "nis": float(np.mean(nis)) if nis else None,
        "nis_expected": 2.0,
        "outside_95": float(np.mean(np.array(nis) > _CHI2_95)) if nis else None,
        "outside_95_expected": 0.05,
    }
