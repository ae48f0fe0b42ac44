"""Contact model: the probability that an approach touches a taxel, from the displacement of its path.

On a robot that errs by centimetres D and TTC (R eqs 1–2) do not distinguish a path over this taxel from one over its
neighbour, 2–3 cm beside it; the displacement u from the taxel does.  The log-odds of touch of taxel k are

    b_k + (β + β_k)ᵀ z + g(z)

with the taxel's own intercept b_k, the standardised displacement z, slopes β common to all taxels and β_k of this
one, and a smooth function g common to all taxels (Gaussian process).  The posterior is Laplace's approximation.

The prior variances of β, β_k and g are hypotheses, of which one is that paths say nothing (all 0).  A hypothesis weighs
as much as it has predicted blocks of the session that were left out, consecutive trials, averaged over resampled blocks
(pseudo-BMA+: Yao et al. 2018, "Using stacking to average Bayesian predictive distributions").  So a prediction leaves
the taxel's rate of touch only as far as paths have been shown to matter.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, expit, log_expit

from learning.pps.trials import Trial
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask

_HYPOTHESES = ((0.0, 0.0, 0.0), *(s for s in product((0.0, 2.0), (0.0, 0.6, 2.0), (0.0, 1.0, 4.0)) if any(s)))
_CENTRES = 16  # paths at which the smooth function g is represented
_LENGTH = 1.6  # length scale of g in standard deviations of the paths
_RIDGE = 1e-3  # added to the covariance of g at the centres, so that paths that coincide do not make it singular
_LEAST_SPREAD_M = 0.003  # of paths: what repeats more exactly than this is no measure of the robot
_FEW_TRIALS = 5.0  # of another session, after which half of what its spread exceeds the first one's by is believed
# Chosen on simulated sessions where no source is given (docs/peripersonal_space.md, "A real robot").
_SAMPLES = 3  # number of last known samples whose displacements are averaged
_REACH_M = 0.20  # greatest distance of a sample from the taxel (R's receptive field)
_MAX_AGE_S = 0.3  # a path whose last known sample is older is lost: in 0.3 s an object at 10 cm/s passes a taxel
# A taxel's rate among paths in reach, far away or lost borrows, at most, so many trials from the others.
_PRIOR_TRIALS = 20.0
_OFFSET_M = 0.012  # standard deviation, each axis, of another session's offset (R Fig 8: mean offsets of 1.2–2.1 cm)
_FREEDOM = 12.0  # degrees of freedom of the t distribution of displacements: those in its tails have less weight
_BLOCKS = 4  # of consecutive trials that are predicted from the others, to weigh the hypotheses
_BASE_RATE_PRIOR = 0.8  # prior probability that paths say nothing
_LEVEL = 0.9  # probability that the credible interval holds
_LOGISTIC = np.pi / 8  # the mean of expit(x), x ~ N(m, v), is about expit(m / √(1 + π v / 8))


class Paths(NamedTuple):
    """Where the paths of trials pass the taxels."""

    u_m: Array
    """(trials, n, 3) mean displacement over the last samples known; NaN where the path is far away or lost."""
    lost: Mask
    """(trials, n) nothing is known of the path shortly before the horizon."""

    @property
    def in_reach(self) -> Mask:
        """(trials, n)"""
        return ~np.isnan(self.u_m[..., 0])


class Posterior(NamedTuple):
    """Gaussian posterior of the coefficients under one hypothesis."""

    used: NDArray[np.intp]
    """(m,) the features whose coefficients are not 0."""
    mean: Array
    """(m,)"""
    cov: Array
    """(m, m)"""


@dataclass(frozen=True)
class Features:
    """Features of a path at a taxel: its intercept, the common and the own slopes, and the smooth function."""

    middle_m: Array
    """(n, 3) median displacement of each taxel's paths; 0 where none was in reach."""
    common_m: Array
    """(3,) median displacement over all taxels."""
    spread_m: Array
    """(3,) standard deviation of the paths, from the median absolute deviation."""
    centres: Array
    """(c, 3) standardised displacements at which the smooth function is represented."""
    whitening: Array
    """(c, c) from the covariances with the centres to features of unit variance."""
    offsets: Array
    """(c,) mean of these features."""

    def of(self, u_m: Array, taxel: NDArray[np.intp]) -> Array:
        """(N, features) of displacements u_m (N, 3) from these taxels (N,)."""
        intercept = np.eye(len(self.middle_m))[taxel]
        common = _standardised(u_m - self.common_m, self.spread_m)
        own = intercept[:, :, None] * _standardised(u_m - self.middle_m[taxel], self.spread_m)[:, None, :]
        apart = np.sum((common[:, None] - self.centres) ** 2, axis=2)
        smooth = np.exp(-0.5 * apart / _LENGTH**2) @ self.whitening - self.offsets
        return np.hstack([intercept, common, own.reshape(len(u_m), 3 * len(self.middle_m)), smooth])

    def prior_variances(self, hypothesis: tuple[float, float, float]) -> Array:
        """(features,) under a hypothesis; inf for the intercepts, whose prior is in touches and misses."""
        n = len(self.middle_m)
        common, own, smooth = np.square(hypothesis)
        return np.repeat([np.inf, common, own, smooth], [n, 3, 3 * n, len(self.centres)])


def _standardised(apart_m: Array, spread_m: Array) -> Array:
    z = apart_m / spread_m
    weight = (_FREEDOM + 3) / (_FREEDOM + np.sum(z**2, axis=1, keepdims=True))
    standardised: Array = z * np.minimum(weight, 1.0)
    return standardised


@dataclass(frozen=True)
class SessionPaths:
    """The mean displacement over all taxels, of the trials of a session in reach of all of them."""

    mean_m: Array
    """(3,)"""
    var_m2: Array
    """(3,) of one trial about the mean of its block."""
    wander_m2: Array
    """(3,) of a block's expected mean: how far people wander in where they aim."""
    trials: int
    """Number of these trials."""


@dataclass(frozen=True)
class ContactModel:
    """What n taxels have learned."""

    seen: Mask
    """(n,) whether a path came within reach."""
    counts: Array
    """(3, 2, n) touches and misses by paths in reach, far away and lost, priors included."""
    features: Features | None
    """Of paths in reach; None where there were none."""
    posteriors: tuple[Posterior, ...]
    """One a hypothesis."""
    weights: Array
    """(hypotheses,) their posterior probability, the first of that paths say nothing."""
    session: SessionPaths | None
    """Paths of the session learned from; None where fewer than two trials were in reach of all taxels."""


@dataclass(frozen=True)
class ContactPrediction:
    """(trials, taxels) each."""

    probability: Array
    """Of touch; where the path is far away or lost, the taxel's rate of touch of such paths."""
    lower: Array
    """Lower end of its credible interval."""
    upper: Array
    """Upper end."""
    in_reach: Mask
    """Whether the path, and some path learned from, came within reach by the horizon."""
    lost: Mask
    """Whether nothing was known of the path shortly before the horizon."""


def displacements(horizon_s: float, trials: tuple[Trial, ...]) -> Paths:
    """Where the paths of trials pass the taxels, by the samples up to `horizon_s` before a trial's end.

    InputError for a horizon that is not 0 or more.
    """
    if not (np.isfinite(horizon_s) and horizon_s >= 0):
        raise InputError("contact", f"a horizon of {horizon_s} s: expected 0 or more")
    found = [[_last(horizon_s, trial, d) for d in trial.d_m.swapaxes(0, 1)] for trial in trials]
    u = np.array([[mean for mean, _ in row] for row in found])
    return Paths(u, np.array([[lost for _, lost in row] for row in found]))


def _last(horizon_s: float, trial: Trial, d: Array) -> tuple[Array, bool]:
    """Mean displacement (3,), NaN where the path is not in reach, and whether it is lost."""
    until_s = trial.stamps_s[-1] - horizon_s + 1e-9
    known = (trial.stamps_s <= until_s) & np.isfinite(d).all(axis=1)
    nothing = np.full(3, np.nan)
    if not known.any() or until_s - trial.stamps_s[known][-1] > _MAX_AGE_S:
        return nothing, True
    last = d[known][-_SAMPLES:]
    near = np.einsum("ij,ij->i", last, last) <= _REACH_M**2
    return (last[near].mean(axis=0) if near[-1] else nothing), False


def learn_contact(horizon_s: float, trials: tuple[Trial, ...]) -> ContactModel:
    """The contact model of the trials of one session, in the order of time."""
    paths, touched = displacements(horizon_s, trials), np.array([trial.touched for trial in trials])
    counts, prior = _counts(paths, touched)
    seen: Mask = np.asarray(paths.in_reach.any(axis=0))
    if not seen.any():
        return ContactModel(seen, counts + prior, None, (), np.ones(1), None)
    trial, taxel = np.nonzero(paths.in_reach)
    u_m, y = paths.u_m[trial, taxel], touched[trial, taxel].astype(float)
    features = _features(u_m, taxel, touched.shape[1])
    posteriors, weights = _weigh(features, features.of(u_m, taxel), y, trial, prior[0])
    return ContactModel(seen, counts + prior, features, posteriors, weights, _session(paths))


def _counts(paths: Paths, touched: Mask) -> tuple[Array, Array]:
    """(3, 2, n) numbers of touches and of misses by paths in reach, far away and lost, and their priors: Jeffreys', and
    up to `_PRIOR_TRIALS` borrowed from the other kinds of path."""
    kinds = np.stack([paths.in_reach, ~paths.in_reach & ~paths.lost, paths.lost])
    counts = np.stack([(kinds & touched).sum(axis=1), (kinds & ~touched).sum(axis=1)], axis=1).astype(float)
    others = counts.sum(axis=0) - counts
    n_others = others.sum(axis=1, keepdims=True)
    return counts, 0.5 + others * np.minimum(n_others, _PRIOR_TRIALS) / np.maximum(n_others, 1)


def _features(u_m: Array, taxel: NDArray[np.intp], n: int) -> Features:
    middle = np.array([np.median(u_m[taxel == k], axis=0) if np.any(taxel == k) else np.zeros(3) for k in range(n)])
    common = np.median(u_m, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(u_m - middle[taxel]), axis=0), _LEAST_SPREAD_M)
    chosen = np.unique(np.linspace(0, len(u_m) - 1, _CENTRES).round().astype(np.intp))
    centres = _standardised(u_m[chosen] - common, spread)
    apart = np.sum((centres[:, None] - centres) ** 2, axis=2)
    whitening = np.linalg.inv(np.linalg.cholesky(np.exp(-0.5 * apart / _LENGTH**2) + _RIDGE * np.eye(len(centres)))).T
    rest = middle, common, spread, centres, whitening
    smooth = Features(*rest, np.zeros(len(centres))).of(u_m, taxel)[:, -len(centres) :]
    return Features(*rest, smooth.mean(axis=0))


def _weigh(
    features: Features, X: Array, y: Array, trial: NDArray[np.intp], prior: Array
) -> tuple[tuple[Posterior, ...], Array]:
    """The posterior under each hypothesis, and the hypotheses' weights.

    The (2, n) touches and misses of the `prior` count as those by each taxel's usual path.
    """
    n = len(features.middle_m)
    usual = np.hstack([np.tile(np.eye(n), (2, 1)), np.zeros((2 * n, X.shape[1] - n))])
    X, y = np.vstack([X, usual]), np.concatenate([y, np.repeat([1.0, 0.0], n)])
    count = np.concatenate([np.ones(len(trial)), prior.ravel()])
    in_order = np.unique(trial, return_inverse=True)[1]
    block = np.concatenate([in_order * _BLOCKS // (in_order.max() + 1), np.full(2 * n, -1)])
    posteriors, log_p = [], np.empty((_BLOCKS, len(_HYPOTHESES)))
    for h, hypothesis in enumerate(_HYPOTHESES):
        variances = features.prior_variances(hypothesis)
        posteriors.append(whole := _laplace(X, y, count, variances))
        for b in range(_BLOCKS):
            out = block == b
            mean, _, by_path = _log_odds(_laplace(X[~out], y[~out], count[~out], variances, whole.mean), X[out], n)
            log_odds = mean / np.sqrt(1 + _LOGISTIC * by_path)
            log_p[b, h] = log_expit(np.where(y[out] > 0, log_odds, -log_odds)).sum()
    others = (1 - _BASE_RATE_PRIOR) / (len(_HYPOTHESES) - 1)
    log_prior = np.log([_BASE_RATE_PRIOR] + [others] * (len(_HYPOTHESES) - 1))
    draws = product(range(_BLOCKS), repeat=_BLOCKS)  # with replacement, every one of them
    resampled = np.array([np.bincount(draw, minlength=_BLOCKS) for draw in draws])
    log_weights = log_prior + resampled @ log_p
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    return tuple(posteriors), (weights / weights.sum(axis=1, keepdims=True)).mean(axis=0)


def _laplace(X: Array, y: Array, count: Array, variances: Array, start: Array | None = None) -> Posterior:
    """Laplace's approximation of logistic regression with independent Gaussian priors of mean 0 (Newton's method)."""
    used = np.flatnonzero(variances > 0)
    X, precision = X[:, used], 1 / variances[used]
    mean = np.zeros(len(used)) if start is None else start
    for _ in range(60):
        p = expit(X @ mean)
        curvature = (X * (count * p * (1 - p))[:, None]).T @ X + np.diag(precision)
        step = np.linalg.solve(curvature, X.T @ (count * (y - p)) - precision * mean)
        largest = np.abs(step).max()
        mean = mean + step * min(1.0, 3 / max(largest, 1e-9))  # a longer step may leave where the curvature holds
        if largest < 1e-6:
            break
    p = expit(X @ mean)
    return Posterior(used, mean, np.linalg.inv((X * (count * p * (1 - p))[:, None]).T @ X + np.diag(precision)))


def _log_odds(posterior: Posterior, X: Array, n: int) -> tuple[Array, Array, Array]:
    """(N,) mean and variance of the log-odds, and that part of the variance which the path adds to the intercept's."""
    x = X[:, posterior.used]
    variance = np.einsum("ni,ij,nj->n", x, posterior.cov, x)
    of_intercept = np.einsum("ni,ij,nj->n", x[:, :n], posterior.cov[:n, :n], x[:, :n])
    return x @ posterior.mean, variance, np.maximum(variance - of_intercept, 0.0)


def _session(paths: Paths) -> SessionPaths | None:
    of_trials = paths.u_m[paths.in_reach.all(axis=1)].mean(axis=1)
    n = len(of_trials)
    if n < 2:
        return None
    blocks = np.array_split(of_trials, min(_BLOCKS, n // 2))
    means = np.array([block.mean(axis=0) for block in blocks])
    within = sum((len(b) * b.var(axis=0) for b in blocks), start=np.zeros(3)) / (n - len(blocks))
    between = means.var(axis=0, ddof=1) if len(blocks) > 1 else np.zeros(3)
    wander = np.maximum(between - within * len(blocks) / n, 0.0)
    return SessionPaths(of_trials.mean(axis=0), within, wander, n)


def predict_contact(horizon_s: float, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """Predict the touches of trials of the same session."""
    paths = displacements(horizon_s, trials)
    return _predict(learned, paths, np.zeros((len(trials), 3)))


def predict_session(horizon_s: float, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """Predict the touches of another session, trial by trial in their order.

    Its kinematics and cameras have another offset, prior N(0, `_OFFSET_M`²).  Its posterior mean is estimated from the
    paths of this and earlier trials, as far as those of the first session stay where they are.  What remains unknown,
    and the spread of the paths beyond that of the first session, draws predictions towards even odds.
    """
    paths = displacements(horizon_s, trials)
    offset, variance = _offsets(learned, paths)
    moved = paths._replace(u_m=paths.u_m - offset[:, None])
    return _predict(learned, moved, variance)


def _offsets(learned: ContactModel, paths: Paths) -> tuple[Array, Array]:
    """(trials, 3) posterior mean in m of the session's offset at each of its trials, and the variance in m² of where
    a path is: that of the offset, and by how much the paths spread more than those of the first session."""
    prior = _OFFSET_M**2
    if learned.session is None:
        return np.zeros((len(paths.u_m), 3)), np.full((len(paths.u_m), 3), prior)
    usual, in_reach = learned.session, np.asarray(paths.in_reach.all(axis=1))
    apart = np.where(in_reach[:, None], paths.u_m.mean(axis=1) - usual.mean_m, 0.0)
    n = np.cumsum(in_reach)[:, None]
    known = np.maximum(n, 1)
    noise = usual.var_m2 * (1 / known + 1 / usual.trials) + usual.wander_m2 * (1 + 1 / _BLOCKS)
    share = np.where(n > 0, prior / (prior + noise), 0.0)
    mean = np.cumsum(apart, axis=0) / known
    squares = np.cumsum(np.where(in_reach[:, None], apart**2, 0.0), axis=0) - known * mean**2
    more = (squares - (known - 1) * (usual.var_m2 + usual.wander_m2)) / (known - 1 + _FEW_TRIALS)
    return share * mean, prior * (1 - share) + np.maximum(more, 0.0)


def _predict(learned: ContactModel, paths: Paths, var_m2: Array) -> ContactPrediction:
    """The prediction for paths known with a variance of (trials, 3) in m²."""
    in_reach: Mask = np.asarray(paths.in_reach & learned.seen)
    kind = np.where(paths.lost, 2, np.where(paths.in_reach, 0, 1))
    every = np.arange(kind.shape[1])
    touched, missed = (learned.counts[kind, outcome, every] for outcome in (0, 1))
    trials = touched + missed
    probability = touched / trials
    if learned.features is not None:
        trial, taxel = np.nonzero(in_reach)
        p, worth = _of_paths(learned, learned.features, paths.u_m[trial, taxel], taxel, var_m2[trial])
        probability[trial, taxel], trials[trial, taxel] = p, worth
    tails = 0.5 * (1 - _LEVEL), 0.5 * (1 + _LEVEL)
    lower, upper = (betaincinv(trials * probability, trials * (1 - probability), tail) for tail in tails)
    return ContactPrediction(probability, lower, upper, in_reach, paths.lost)


def _of_paths(
    learned: ContactModel, features: Features, u_m: Array, taxel: NDArray[np.intp], var_m2: Array
) -> tuple[Array, Array]:
    """(N,) probabilities of touch, and the number of trials of a Beta distribution with the same mean and the same
    variance of the log-odds."""
    n, step = len(features.middle_m), 0.1 * features.spread_m
    X = features.of(u_m, taxel)
    slopes = [(features.of(u_m + e, taxel) - features.of(u_m - e, taxel)) / (2 * e.sum()) for e in np.diag(step)]
    means, variances, p = [], [], []
    for posterior in learned.posteriors:
        mean, variance, by_path = _log_odds(posterior, X, n)
        by_offset = sum((s[:, posterior.used] @ posterior.mean) ** 2 * v for s, v in zip(slopes, var_m2.T, strict=True))
        means.append(mean)
        variances.append(variance + by_offset)
        p.append(expit(mean / np.sqrt(1 + _LOGISTIC * (by_path + by_offset))))
    weights = learned.weights
    probability = np.clip(weights @ np.array(p), 1e-9, 1 - 1e-9)
    middle = weights @ np.array(means)
    variance = weights @ (np.array(variances) + (np.array(means) - middle) ** 2)
    return probability, 1 / (variance * probability * (1 - probability))
