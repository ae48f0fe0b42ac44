"""The delay between the clocks of two cameras, from points that both follow.

At the true delay τ the right image's point, interpolated at t + τ, and the left one's at t fit one 3D point: the
epipolar residual e(t, τ) is 0 but for noise and the calibration's error.  The latter is taken to be affine in the
image, so that

    e(t, τ) = β₀ + β₁ u + β₂ v + noise        ∂e/∂τ = s(t), the rate across the epipolar lines

is solved by Gauss–Newton from the best delay of a search.  Its standard error counts noise that is correlated in time
(a jackknife over parts of the recording).  Where s hardly varies, or no more than noise lets it, the delay is
unobservable: nothing moves across the epipolar lines, or at a constant rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pps_vision.app.points import Pairs, epipolar_residuals
from pps_vision.errors import expect_positive
from pps_vision.geometry.camera import StereoView
from pps_vision.types import Array, Mask

_ITERATIONS = 8
_SPAN_FRAMES = 1.5  # half the span of a rate
_TO_STD = 1.4826  # times a normal distribution's median absolute deviation
_VALLEYS = 4  # delays from which the best is refined
_JACKKNIFE = 8  # parts, one of which is left out
_UNKNOWN_PX = 1000.0
_MOST_DRIFT = 4.0  # standard deviations
_MOST_PARTS = 8  # whose delays are compared
_ACROSS = ("nothing moves across the epipolar lines", "all moves at a constant rate across the epipolar lines")
_INTERPOLATION = 0.0005  # error of interpolation, frames (simulated, seeds 100 to 129, 0.05 px)


@dataclass(frozen=True)
class ClockParams:
    """Search range and tests of observability."""

    range_s: float = 1.0  # largest delay, either way
    gate_sigma: float = 3.5  # residuals further out are outliers
    gap_frames: float = 1.6  # longest interval between samples, in median intervals, across which is interpolated
    fewest: int = 30  # pairs that are needed
    signal: float = 4.0  # least ratio of the variance of the rate across the epipolar lines and that of its noise
    ambiguity: float = 1.5  # least ratio of the residuals at the next best delay and at the best
    most_std_frames: float = 0.1  # largest standard error of a delay, in frames
    drift_std: float = 1e-3  # prior standard deviation of the drift
    calibration_px: float = 1.0  # prior σ of the change of the calibration's error over the points' σ

    def __post_init__(self) -> None:
        expect_positive("clock", self)


class PointPath(NamedTuple):
    """The samples of one point in one camera: rising stamps (n,) s and pixels (n, 2), without gaps as NaN."""

    stamps_s: Array
    pixels: Array

    def between(self, first_s: float, last_s: float) -> "PointPath":
        """The samples from a stamp on and before another."""
        chosen = (self.stamps_s >= first_s) & (self.stamps_s < last_s)
        return PointPath(self.stamps_s[chosen], self.pixels[chosen])


class Delay(NamedTuple):
    """Delay of the right camera's stamps, or of the joints, at a stamp, s, its drift, and their standard errors; or why
    there is none."""

    delay_s: float = np.nan
    std_s: float = np.nan
    drift: float = np.nan
    drift_std: float = np.nan
    at_s: float = np.nan
    unobservable: str = ""
    frame_s: float = np.nan

    def __str__(self) -> str:
        if self.unobservable:
            return f"unobservable, {self.unobservable}"
        low_ms, high_ms = (1000 * (self.delay_s + k * self.std_s) for k in (-1.96, 1.96))
        drift = f", drift {1e6 * self.drift:.0f} ± {1.96e6 * self.drift_std:.0f} ppm" if self.drifts else ""
        return f"{1000 * self.delay_s:.2f} ms late (95 %: {low_ms:.2f} to {high_ms:.2f}){drift}"

    @property
    def is_known(self) -> bool:
        """Whether the delay is observable."""
        return not self.unobservable

    @property
    def drifts(self) -> bool:
        """Whether the drift's 99.9 % interval excludes 0."""
        return self.is_known and abs(self.drift) > 3.3 * self.drift_std

    @property
    def is_late(self) -> bool:
        """Whether the delay's 99.9 % interval excludes 0, or it drifts."""
        return self.is_known and (abs(self.delay_s) > 3.3 * self.std_s or self.drifts)

    def at(self, stamps_s: Array) -> Array:
        """The delay at stamps."""
        return self.delay_s + (self.drift if self.drifts else 0.0) * (stamps_s - self.at_s)


def estimate_delay(params: ClockParams, view: StereoView, points: Sequence[tuple[PointPath, PointPath]]) -> Delay:
    """Return the delay of the right camera's stamps behind the left one's, of fixed cameras, by the left and the right
    path of each point.

    Where the delays of successive parts differ by half a frame or more, it is not one delay: images are missing.
    """
    whole = _camera_delay(params, view, points)
    stamps = np.sort(np.concatenate([left.stamps_s for left, _ in points])) if points else np.zeros(0)
    parts = min(3 * len(stamps) // (4 * params.fewest), _MOST_PARTS)
    edges = np.append(stamps[np.arange(parts) * len(stamps) // max(parts, 1)], np.inf) if parts > 2 else np.zeros(0)
    found = [
        _camera_delay(params, view, [(left.between(a, b), right) for left, right in points])
        for a, b in pairwise(edges.tolist())
    ]
    known = [part for part in found if part.is_known]
    steps = [
        f"{1000 * a.delay_s:.1f} ms at {a.at_s - stamps[0]:.1f} s, {1000 * b.delay_s:.1f} at {b.at_s - stamps[0]:.1f} s"
        for a, b in pairwise(known)
        if abs(change := b.delay_s - a.delay_s) > max(0.5 * a.frame_s, 3.3 * np.hypot(a.std_s, b.std_s))
        and abs(change) > 2 * abs(whole.drift if whole.is_known else 0.0) * (b.at_s - a.at_s)
    ]
    return Delay(unobservable=f"not one delay: {'; '.join(steps)}: are images missing?") if steps else whole


def _camera_delay(params: ClockParams, view: StereoView, points: Sequence[tuple[PointPath, PointPath]]) -> Delay:
    """`estimate_delay`, taken as one delay that may drift."""
    paths = [(a, Interpolator(b, params.gap_frames)) for a, b in points if min(len(a.stamps_s), len(b.stamps_s)) > 1]
    stamps = np.concatenate([left.stamps_s for left, _ in paths]) if paths else np.zeros(0)
    if len(stamps) < params.fewest:
        return Delay(unobservable=f"{len(stamps)} images with a point; expected {params.fewest}")
    frame_s = float(np.median(np.concatenate([np.diff(left.stamps_s) for left, _ in paths])))
    edges = np.cumsum([len(left.stamps_s) for left, _ in paths])[:-1]
    pixels = np.concatenate([left.pixels for left, _ in paths])
    where = (pixels - pixels.mean(axis=0)) / (pixels.std(axis=0) + 1e-9)
    nuisance = np.column_stack([_UNKNOWN_PX * np.ones(len(stamps)), params.calibration_px * where])

    def residuals(delay_s: Array | float) -> Array:
        """Epipolar residuals (n,) if the right stamps are that late."""
        times = np.split(stamps + delay_s, edges)
        right_pixels = np.concatenate([right(at_s) for (_, right), at_s in zip(paths, times, strict=True)])
        both = np.stack([pixels, right_pixels], axis=1)
        cov = np.broadcast_to(np.eye(2), (len(both), 2, 2, 2))
        return epipolar_residuals(view, Pairs(both, np.full((len(both), 2), np.nan), cov))[0]

    span_s = _SPAN_FRAMES * frame_s
    spread = 1 / (2 * span_s) ** 2  # variance of a rate of two samples of the right camera's half
    at_s = float(stamps.mean())
    has_prior = np.array([0.0, 1.0, *np.ones(nuisance.shape[1])])  # all but the delay; standard deviations of 1
    mean = np.zeros_like(has_prior)

    def refined(delay_s: float) -> tuple[float, Array, Array, Array, Mask]:
        """Robust scale of the residuals, delay and drift, regressors, residuals, and which are used, by Gauss–Newton
        from a delay; an infinite scale where too few images remain."""
        theta = np.array([delay_s, 0.0])
        for _ in range(_ITERATIONS):
            at = theta[0] + theta[1] * (stamps - at_s)
            e = residuals(at)
            rate = (residuals(at + span_s) - residuals(at - span_s)) / (2 * span_s)
            X = np.column_stack([rate, params.drift_std * rate * (stamps - at_s), nuisance])
            known = np.isfinite(e) & np.isfinite(rate)
            if known.sum() < params.fewest:
                return np.inf, theta, X, e, known
            rest, is_inside = _without(e, nuisance, params.gate_sigma)
            used = known & ~np.convolve(known & ~is_inside, np.ones(5), "same").astype(bool)  # interpolation spreads it
            mean[1] = -theta[1] / params.drift_std
            change = _ridge(X[used], e[used], float(np.std(rest[used])) * has_prior, mean)
            theta = theta - np.array([1.0, params.drift_std]) * change[:2]
        return _scale(e, nuisance, params), theta, X, e, used

    n = int(np.ceil(2 * params.range_s / frame_s))
    grid = 0.5 * frame_s * np.arange(-n, n + 1)
    costs = np.nan_to_num([_scale(residuals(delay_s), nuisance, params) for delay_s in grid], nan=np.inf)
    lower = np.minimum(np.append(np.inf, costs[:-1]), np.append(costs[1:], np.inf))
    valleys = [k for k in np.argsort(costs) if costs[k] <= lower[k] and np.isfinite(costs[k])][:_VALLEYS]
    fits = sorted((refined(float(grid[k])) for k in valleys), key=lambda fit: fit[0])
    if not fits or not np.isfinite(fits[0][0]):
        return Delay(unobservable=f"no {params.fewest} images of both at one time")
    scale, theta, X, e, used = fits[0]
    X, e = X[used], e[used]
    noise = e - X @ np.linalg.lstsq(X, e, rcond=None)[0]
    stds, share = _stds(X, noise)
    noise_of_rate = float(np.var(noise)) * spread / max(share, 1e-300)  # relative to what of the rate nothing explains
    if noise_of_rate > 1 / params.signal:
        moves = np.mean(X[:, 0] ** 2) > 4 * params.signal * np.var(noise) * spread
        return Delay(unobservable=_ACROSS[int(moves)])
    std = np.hypot(stds[0] / (1 - noise_of_rate), _INTERPOLATION * frame_s)  # the regressor is noisy too
    if not std < params.most_std_frames * frame_s:
        return Delay(unobservable=f"{_ACROSS[0]}: ± {1000 * std:.2g} ms (σ)")
    if abs(theta[1]) > _MOST_DRIFT * params.drift_std:
        return Delay(unobservable=f"only a drift of {1e6 * theta[1]:.0f} ppm would fit: are images missing?")
    others = [fit[0] for fit in fits if abs(fit[1][0] - theta[0]) > 0.5 * frame_s]
    if others and others[0] < params.ambiguity * scale:
        return Delay(unobservable=f"other delays than {1000 * theta[0]:.1f} ms fit about as well")
    return Delay(float(theta[0]), float(std), float(theta[1]), float(params.drift_std * stds[1]), at_s, frame_s=frame_s)


class Interpolator:
    """A point's pixels between its samples, by cubic Hermite splines; NaN beyond them and in long gaps."""

    def __init__(self, path: PointPath, gap_frames: float) -> None:
        self._stamps_s = path.stamps_s
        self._longest_s = gap_frames * float(np.median(np.diff(path.stamps_s)))
        slopes = np.gradient(path.pixels, path.stamps_s, axis=0)
        if len(slopes) > 4:  # of fourth order where samples are regular
            t, x = path.stamps_s, path.pixels
            steps = np.lib.stride_tricks.sliding_window_view(np.diff(t), 4)
            regular = np.ptp(steps, axis=1) < 0.2 * steps.mean(axis=1)
            fourth = (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * steps.mean(axis=1))[:, None]
            slopes[2:-2][regular] = fourth[regular]
        self._spline = CubicHermiteSpline(path.stamps_s, path.pixels, slopes, extrapolate=False)

    def __call__(self, stamps_s: Array) -> Array:
        """(n, 2) pixels at stamps (n,)."""
        after = np.clip(np.searchsorted(self._stamps_s, stamps_s), 1, len(self._stamps_s) - 1)
        gaps = self._stamps_s[after] - self._stamps_s[after - 1]
        pixels = self._spline(stamps_s)
        pixels[gaps > self._longest_s] = np.nan
        return np.asarray(pixels)


def _scale(e: Array, nuisance: Array, params: ClockParams) -> float:
    """Robust standard deviation of residuals without the calibration's part; NaN for fewer than half."""
    known = np.isfinite(e)
    if known.sum() < max(params.fewest, 0.5 * len(e)):
        return np.nan
    return _TO_STD * float(np.median(np.abs(_without(e, nuisance, params.gate_sigma)[0][known])))


def _without(e: Array, nuisance: Array, gate_sigma: float) -> tuple[Array, Mask]:
    """Residuals (n,) without the calibration's part, and a mask of the inliers."""
    known = np.isfinite(e)
    rest: Array = e - np.median(e[known])
    for width in (2, 1, 1):
        std = _TO_STD * max(float(np.median(np.abs(rest[known]))), 1e-6)
        used = known & (np.abs(rest) <= width * gate_sigma * std)
        rest = e - nuisance @ _ridge(nuisance[used], e[used], np.full(nuisance.shape[1], std))
    return rest, used


def _ridge(X: Array, y: Array, weights: Array, mean: Array | float = 0.0) -> Array:
    """Coefficients β (k,) of least squares X β = y with a prior `mean`, of `weights` (k,): noise over its deviation."""
    return np.asarray(np.linalg.lstsq(np.vstack([X, np.diag(weights)]), np.append(y, weights * mean), rcond=None)[0])


def _stds(X: Array, noise: Array) -> tuple[Array, float]:
    """Standard errors (k,) of least squares X β = y, all β but the first ± 1 beforehand, and the mean square of the
    part of the first regressor that the others do not explain.

    The larger of those for white noise, and for noise that is correlated in time (a jackknife that leaves out one of
    successive parts, Künsch 1989).
    """
    var = float(np.mean(noise**2)) * len(X) / max(len(X) - X.shape[1], 1)
    prior = var * np.diag([0.0, *np.ones(X.shape[1] - 1)])
    cov = np.linalg.pinv(X.T @ X + prior, hermitian=True)
    of_part = np.arange(len(X)) * _JACKKNIFE // len(X)
    others = [of_part != k for k in range(_JACKKNIFE)]
    without = [np.linalg.pinv(X[kept].T @ X[kept] + prior, hermitian=True) @ X[kept].T @ noise[kept] for kept in others]
    correlated = (_JACKKNIFE - 1) * np.var(without, axis=0)
    return np.sqrt(np.maximum(correlated, var * np.diag(cov))), 1 / max(len(X) * float(cov[0, 0]), 1e-300)
