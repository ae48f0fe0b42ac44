"""Predictors of touch: the base rate, maps of D and TTC, trees, and the landing point.

A `Predictor` learns from some trials and returns the probabilities (trials, taxels) that other trials touch each taxel,
from what is known `horizon_s` before their end.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.isotonic import IsotonicRegression

from learning.pps.memory import MemoryParams, activation, windows
from learning.pps.receptive_field import ReceptiveField
from pps_vision.experiments.pps.perceived import HORIZON_S, at_horizon, known_at, perceive, train_memory
from pps_vision.experiments.pps.scores import auroc, brier
from pps_vision.experiments.pps.taxel_trials import Trial, touch_rates
from pps_vision.experiments.study import interval
from pps_vision.types import Array, Mask

Trials = Sequence[Trial]
Predictor = Callable[[Trials, Trials, float], Array]
"""Training trials, test trials, horizon_s → probabilities (test trials, taxels)."""
Score = Callable[[ArrayLike, ArrayLike], float]
"""Outcomes and probabilities → score."""

FOLDS = 8
PRIORS = (1.0, 10.0, 100.0, 1000.0, 1e9)
PRIOR_BLOCKS = 4
_HALF_WINDOWS = MemoryParams(bins=(16, 8), sigma_bins=0.5)
_FINE = MemoryParams(bins=(32, 16))
_POOLED = 0.2  # weight of the samples of every other taxel in the fine map, chosen on earlier training trials
_AHEAD_S = np.arange(0.0, 0.6, 0.01)  # how far a path is continued
_NEVER_S = 100.0  # in place of an infinite TTC: trees know the order of inputs only, but are binned at their quantiles
_FAR_M = 0.2  # gaps beyond the receptive field count as this one
_SURFACE = ReceptiveField(distance_to="surface", min_closing_sigmas=0.0)
_AUTHORS = MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75)  # of the authors' own code


def outcomes(trials: Trials) -> Mask:
    """Return what was touched (trials, taxels)."""
    return np.array([trial.touched for trial in trials])


def by_base_rate(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict how often each taxel was touched, whatever the path."""
    return np.tile(touch_rates(tuple(training)), (len(test), 1))


def by_map(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict R's activation at the last sample known."""
    return activation(train_memory(training), *at_horizon(test, horizon_s))


def by_authors_map(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict the activation of a map with the parameters of the authors' code, averaged over the samples known; the
    base rate where the map covers none."""
    memory, base_rate = train_memory(training, _AUTHORS), touch_rates(tuple(training))
    p = np.empty((len(test), len(base_rate)))
    for k, trial in enumerate(test):
        D, TTC = (samples[known_at(trial.stamps_s, horizon_s)] for samples in perceive(trial))
        covered = _AUTHORS.covers(D, TTC)
        total, n = (activation(memory, D, TTC) * covered).sum(axis=0), covered.sum(axis=0)
        p[k] = np.where(n > 0, total / np.maximum(n, 1), base_rate)
    return p


def by_fine_map(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict with 32×16 bins of D and TTC to the surface, counts pooled over taxels.

    Positive and all samples are smoothed separately and then divided, so that bins without a sample have no weight; R
    smooths the ratio, in which they count as 0.
    """
    D, TTC = at_horizon(test, horizon_s, _SURFACE)
    memory = train_memory(training, _FINE, _SURFACE)
    counts = (1 - _POOLED) * memory.counts + _POOLED * memory.counts.sum(axis=0)
    inside = _FINE.covers(D, TTC)
    p = np.zeros(inside.shape)
    w_distance, w_ttc = windows(_FINE, D, TTC, inside)
    seen = np.einsum("kd,kdtc,kt->kc", w_distance, counts[np.nonzero(inside)[-1]], w_ttc)
    p[inside] = seen[:, 0] / np.maximum(seen.sum(axis=1), 1e-12)
    return p


def by_half_windows(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict the activation of a map of 16×8 bins with a window of half a bin at the last sample known."""
    return activation(train_memory(training, _HALF_WINDOWS), *at_horizon(test, horizon_s))


def by_shrunk_map(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict from R's counts, of which `n` prior samples say the taxel's rate of touch: (n⁺ + n r) / (n⁺ + n⁻ + n).

    n⁺ and n⁻ are smoothed by R's window.  n is the one that best
    predicts blocks of the training trials from the others.
    """
    found = [in_blocks(partial(_shrunk, prior), training, horizon_s, PRIOR_BLOCKS) for prior in PRIORS]
    errors = [brier(outcomes(training), p) for p in found]
    return _shrunk(PRIORS[int(np.argmin(errors))], training, test, horizon_s)


def _shrunk(prior: float, training: Trials, test: Trials, horizon_s: float) -> Array:
    memory, p = train_memory(training), by_base_rate(training, test, horizon_s)
    D, TTC = at_horizon(test, horizon_s)
    inside = memory.params.covers(D, TTC)
    w_distance, w_ttc = windows(memory.params, D, TTC, inside)
    seen = np.einsum("kd,kdtc,kt->kc", w_distance, memory.counts[np.nonzero(inside)[-1]], w_ttc)
    p[inside] = (seen[:, 0] + prior * p[inside]) / (seen.sum(axis=1) + prior)
    return p


def by_trees(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict by gradient-boosted trees (scikit-learn's defaults) of the taxel, D, TTC and the displacement from it."""
    return _by_trees(training, test, horizon_s, 6)


def by_trees_of_distance_and_ttc(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict as `by_trees`, of the taxel, D and TTC alone, which is what R's map has."""
    return _by_trees(training, test, horizon_s, 3)


def _by_trees(training: Trials, test: Trials, horizon_s: float, inputs: int) -> Array:
    """Probabilities by trees of the first `inputs` columns of `_rows`."""
    rows = [_rows(trials, horizon_s)[:, :inputs] for trials in (training, test)]
    touched = outcomes(training).ravel()
    if touched.all() or not touched.any():
        return by_base_rate(training, test, horizon_s)
    trees = HistGradientBoostingClassifier(categorical_features=[0], random_state=0).fit(rows[0], touched)
    return np.asarray(trees.predict_proba(rows[1])[:, 1]).reshape(len(test), -1)


def _rows(trials: Trials, horizon_s: float) -> Array:
    """(trials · taxels, 6) taxel, D, TTC and the displacement at the last sample known."""
    D, TTC = at_horizon(trials, horizon_s)
    TTC = np.minimum(TTC, _NEVER_S)
    last = [int(np.flatnonzero(known_at(trial.stamps_s, horizon_s))[-1]) for trial in trials]
    d = np.array([trial.d_m[k] for trial, k in zip(trials, last, strict=True)])
    taxel = np.broadcast_to(np.arange(D.shape[1], dtype=float), D.shape)
    return np.concatenate([np.stack([taxel, D, TTC], axis=-1), d], axis=-1).reshape(-1, 6)


def by_landing(training: Trials, test: Trials, horizon_s: float) -> Array:
    """Predict from the distance between each taxel and the object where the path, continued straight, lands."""
    gaps = [np.minimum([landing_gap(trial, horizon_s) for trial in trials], _FAR_M) for trials in (training, test)]
    return _calibrate(-gaps[0], outcomes(training), -gaps[1])


def landing_gap(trial: Trial, horizon_s: float) -> Array:
    """Return the distance (taxels,) m from each taxel to the object's surface where its path, continued straight from
    `horizon_s` before the end, first meets one of them, or comes nearest; inf where no path was known."""
    known = np.flatnonzero(known_at(trial.stamps_s, horizon_s) & np.isfinite(trial.d_m[:, 0, 0]))
    if len(known) < 2:
        return np.full(len(trial.touched), np.inf)
    before, last = known[-3:][[0, -1]]
    v = (trial.d_m[last] - trial.d_m[before]) / (trial.stamps_s[last] - trial.stamps_s[before])
    gaps = np.linalg.norm(trial.d_m[last] + _AHEAD_S[:, None, None] * v, axis=2) - trial.radius_m
    nearest = gaps.min(axis=1)
    landed: Array = gaps[(nearest <= 0).argmax() if (nearest <= 0).any() else nearest.argmin()]
    return landed


def corrected(predictor: Predictor) -> Predictor:
    """Return the prediction corrected by isotonic regression on folds of the training trials left out in turn."""

    def predict(training: Trials, test: Trials, horizon_s: float) -> Array:
        every = np.arange(len(training))
        folds = [every[k::FOLDS] for k in range(FOLDS)]
        p = [predictor(take(training, np.setdiff1d(every, f)), take(training, f), horizon_s) for f in folds]
        touched = outcomes(training)[np.concatenate(folds)]
        return _calibrate(np.concatenate(p), touched, predictor(training, test, horizon_s))

    return predict


def _calibrate(score: Array, touched: Mask, new_score: Array) -> Array:
    """Probabilities of new scores by isotonic regression of outcomes on scores."""
    regression = IsotonicRegression(out_of_bounds="clip").fit(score.ravel(), touched.ravel())
    return np.asarray(regression.predict(new_score.ravel())).reshape(new_score.shape)


def scored(predictor: Predictor, sets: Iterable[tuple[Trials, Trials]]) -> dict[str, list[float]]:
    """Return AUROC and Brier score of pairs of training and test trials, with 95 % over the pairs, which are robots."""
    found = [(outcomes(test), predictor(training, test, HORIZON_S)) for training, test in sets]
    return {score.__name__: interval([[score(*one)] for one in found]) for score in (auroc, brier)}


def score_interval(score: Score, touched: Mask, p: Array) -> list[float]:
    """Return a score of probabilities (trials, taxels) with its 95 % interval by resampling trials."""
    return interval(list(np.stack([touched, p], axis=-1)), lambda rows: score(rows[:, 0], rows[:, 1]))


def in_blocks(predictor: Predictor, trials: Trials, horizon_s: float, blocks: int | None = None) -> Array:
    """Return probabilities (trials, taxels), each block of consecutive trials predicted from the others (default: every
    trial from all others)."""
    every = np.arange(len(trials))
    parts = np.array_split(every, min(blocks or len(trials), len(trials)))
    return np.concatenate([
        predictor(take(trials, np.setdiff1d(every, part)), take(trials, part), horizon_s) for part in parts
    ])  # fmt: skip


def take(trials: Trials, which: NDArray[np.intp]) -> tuple[Trial, ...]:
    """Return the trials of these indices."""
    return tuple(trials[i] for i in which)
