"""Predictors of touch, and scores of predicted probabilities: discrimination, Brier score, calibration.

A `Predictor` learns from training trials and returns the probability (trials, taxels) that each test trial touches each
taxel, from the samples known at the horizon.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit
from scipy.stats import rankdata, sem
from sklearn.isotonic import IsotonicRegression

from learning.pps.memory import MemoryParams, activation, smoothed
from pps_vision.experiments.pps.taxel_trials import Trial, at_horizon, known_at_horizon, perceive, train_memory
from pps_vision.types import Array, Mask

Trials = Sequence[Trial]
Predictor = Callable[[Trials, Trials], Array]  # training trials, test trials → probabilities (test trials, taxels)

PRIORS = (1.0, 10.0, 100.0, 1000.0, 1e9)
_FOLDS = 8
_BINS = 10  # reliability diagram
_AUTHORS = MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75)  # parameters of the authors' code


def outcomes(trials: Trials) -> Mask:
    """Return the touches (trials, taxels)."""
    return np.array([trial.touched for trial in trials])


def by_base_rate(training: Trials, test: Trials) -> Array:
    """Predict the share of trials that touched each taxel, independent of the path."""
    return np.tile(outcomes(training).mean(axis=0), (len(test), 1))


def by_map(training: Trials, test: Trials) -> Array:
    """Predict the activation of R's map at the last known sample."""
    return activation(train_memory(training), *at_horizon(test))


def by_authors_map(training: Trials, test: Trials) -> Array:
    """Predict the activation of a map with the parameters of the authors' code, averaged over the known samples.

    Where the map covers no sample, predict the base rate.
    """
    memory = train_memory(training, _AUTHORS)
    p = by_base_rate(training, test)
    for k, trial in enumerate(test):
        D, TTC = (samples[known_at_horizon(trial.stamps_s)] for samples in perceive(trial))
        covered = _AUTHORS.covers(D, TTC)
        n = covered.sum(axis=0)
        total = (activation(memory, D, TTC) * covered).sum(axis=0)
        p[k] = np.where(n > 0, total / np.maximum(n, 1), p[k])
    return p


def by_shrunk_map(training: Trials, test: Trials) -> Array:
    """Predict from R's counts with n prior samples at the taxel's rate r of touch: (n⁺ + n r) / (n⁺ + n⁻ + n).

    n⁺ and n⁻ are smoothed by R's window; n is the prior that best predicts blocks of the training trials.
    """
    touched = outcomes(training)
    errors = [brier(touched, in_blocks(partial(_by_shrunk_map, prior), training)) for prior in PRIORS]
    return _by_shrunk_map(PRIORS[int(np.argmin(errors))], training, test)


def _by_shrunk_map(prior: float, training: Trials, test: Trials) -> Array:
    memory = train_memory(training)
    p = by_base_rate(training, test)
    D, TTC = at_horizon(test)
    inside = memory.params.covers(D, TTC)
    taxel = np.nonzero(inside)[-1]
    n_touched, n_not = (
        smoothed(memory.params, memory.counts[..., k].astype(float), taxel, D[inside], TTC[inside]) for k in range(2)
    )
    p[inside] = (n_touched + prior * p[inside]) / (n_touched + n_not + prior)
    return p


def corrected(predictor: Predictor) -> Predictor:
    """Return the prediction corrected by isotonic regression on held-out folds of the training trials."""

    def predict(training: Trials, test: Trials) -> Array:
        folds = [np.arange(k, len(training), _FOLDS) for k in range(_FOLDS)]
        regression = IsotonicRegression(out_of_bounds="clip")
        regression.fit(_held_out(predictor, training, folds).ravel(), outcomes(training).ravel())
        raw = predictor(training, test)
        return np.asarray(regression.predict(raw.ravel())).reshape(raw.shape)

    return predict


def in_blocks(predictor: Predictor, trials: Trials, n_blocks: int = 4) -> Array:
    """Return probabilities (trials, taxels), each block of consecutive trials predicted from the others."""
    return _held_out(predictor, trials, np.array_split(np.arange(len(trials)), n_blocks))


def _held_out(predictor: Predictor, trials: Trials, folds: Sequence[NDArray[np.intp]]) -> Array:
    """Probabilities (trials, taxels), each fold of indices predicted from the others."""
    p = np.zeros(outcomes(trials).shape)
    for fold in folds:
        others = [trial for k, trial in enumerate(trials) if k not in fold]
        p[fold] = predictor(others, [trials[k] for k in fold])
    return p


def auroc(outcome: ArrayLike, score: ArrayLike) -> float:
    """Return the area under the receiver operating characteristic; NaN where all outcomes are equal.

    It is the share of pairs of a positive and a negative outcome in which the positive scores higher; ties count half.
    """
    is_positive = np.asarray(outcome, dtype=bool).ravel()
    n = np.count_nonzero(is_positive)
    if n in (0, len(is_positive)):
        return np.nan
    return float((rankdata(score)[is_positive].mean() - (n + 1) / 2) / (len(is_positive) - n))


def brier(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean squared difference between predicted probability and outcome (0 or 1)."""
    return float(np.mean((np.asarray(probability, dtype=float) - np.asarray(outcome, dtype=float)) ** 2))


def brier_gain(outcome: ArrayLike, probability: ArrayLike, reference: ArrayLike) -> tuple[float, float, float]:
    """Return the Brier score of the reference less that of the prediction, with its 95 % interval.

    The arguments are (units, values of each unit); the interval is Student's t of the paired differences of two or more
    independent units.
    """
    y, p, q = (np.asarray(values, dtype=float) for values in (outcome, probability, reference))
    gains = np.mean((q - y) ** 2 - (p - y) ** 2, axis=1)
    half = float(stdtrit(len(gains) - 1, 0.975) * sem(gains))
    return float(gains.mean()), float(gains.mean()) - half, float(gains.mean()) + half


def expected_calibration_error(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean distance between predicted probability and share of positives in its bin (ten equal bins)."""
    p = np.asarray(probability, dtype=float).ravel()
    index = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    return float(np.abs(np.bincount(index, weights=p - np.ravel(outcome))).sum() / len(p))
