"""Predictors of touch for tracked objects: the base rate, maps of D and TTC, displacement, landing point."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit
from sklearn.isotonic import IsotonicRegression

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.memory import MemoryParams, activation, windows
from learning.pps.receptive_field import ReceptiveField
from learning.pps.touch_trial import TouchTrial
from learning.pps.trials import Trial
from pps_vision.experiments.pps.perceived import (
    HORIZON_S,
    PerceivedTrial,
    at_horizon,
    displacements,
    perceive_trials,
    train_memory,
)
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Mask

FOLDS = 8
FINE = MemoryParams(bins=(32, 16))
_POOLED = 0.2  # weight of the samples of every other taxel in the fine map
_SURFACE = ReceptiveField(subtract_radius=True, min_closing_sigmas=0.0)
_AHEAD_S = np.arange(0.0, 0.6, 0.01)  # how far a path is continued
_FAR_M = 0.2  # distances beyond count as this one


@dataclass(frozen=True)
class Inputs:
    """Trials as the forearm perceives them: D and TTC to the object's centre and to its surface, displacements, and the
    distance in m from each taxel to the predicted landing point of the surface, `landing` (trials, taxels)."""

    center: tuple[PerceivedTrial, ...]
    surface: tuple[PerceivedTrial, ...]
    displacement: tuple[Trial, ...]
    landing: Array

    @classmethod
    def of(cls, trials: tuple[TouchTrial, ...]) -> "Inputs":
        """Return all inputs of trials."""
        robot, skin = load_icub(), icub_skin()
        moved = displacements(trials, robot, skin)
        gaps = [landing_gap(path, _radius(trial), HORIZON_S) for path, trial in zip(moved, trials, strict=True)]
        surface = perceive_trials(trials, robot, skin, field=_SURFACE)
        return cls(perceive_trials(trials, robot, skin), surface, moved, np.minimum(gaps, _FAR_M))

    def take(self, which: Iterable[int]) -> "Inputs":
        """Return some of the trials."""
        k = list(which)
        center, surface = (tuple(trials[i] for i in k) for trials in (self.center, self.surface))
        return Inputs(center, surface, tuple(self.displacement[i] for i in k), self.landing[k])

    @property
    def touched(self) -> Mask:
        """Outcomes (trials, taxels)."""
        return np.array([trial.touched for trial in self.center])


def _radius(trial: TouchTrial) -> float:
    """Median of the object's radius known at the horizon, m; 0 if unknown."""
    known = trial.radius_m[trial.stamps_s <= trial.stamps_s[-1] - HORIZON_S]
    return float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0


Predictor = Callable[[Inputs, Inputs], Array]
"""Training and test trials → probabilities of touch (test trials, taxels)."""


def by_map(training: Inputs, test: Inputs) -> Array:
    """Predict with R's map."""
    return predict_by_map(training.center, test.center)


def predict_by_map(training: Sequence[PerceivedTrial], test: Sequence[PerceivedTrial]) -> Array:
    """Return the activations (test trials, taxels) of R's map at the horizon."""
    D, TTC, _ = at_horizon(test)
    return activation(train_memory(training), D, TTC)


def by_fine_map(training: Inputs, test: Inputs) -> Array:
    """Predict with 32×16 bins of D and TTC to the surface, counts pooled over taxels.

    Positive and all samples are smoothed separately and then divided, so that bins without a sample have no weight; R
    smooths the ratio, in which they count as 0.
    """
    D, TTC, _ = at_horizon(test.surface)
    memory = train_memory(training.surface, FINE)
    counts = (1 - _POOLED) * memory.counts + _POOLED * memory.counts.sum(axis=0)
    inside = FINE.covers(D, TTC)
    p = np.zeros(inside.shape)
    w_distance, w_ttc = windows(FINE, D, TTC, inside)
    seen = np.einsum("kd,kdtc,kt->kc", w_distance, counts[np.nonzero(inside)[-1]], w_ttc)
    p[inside] = seen[:, 0] / np.maximum(seen.sum(axis=1), 1e-12)
    return p


def by_displacement(training: Inputs, test: Inputs) -> Array:
    """Predict from where the path passes each taxel."""
    params = ContactParams()
    return predict_contact(params, learn_contact(params, training.displacement), test.displacement).probability


def by_landing(training: Inputs, test: Inputs) -> Array:
    """Predict from the distance to the landing point."""
    return _calibrate(-training.landing, training.touched, -test.landing)


def by_base_rate(training: Inputs, test: Inputs) -> Array:
    """Predict each taxel's rate of touch."""
    return np.tile(training.touched.mean(axis=0), (len(test.center), 1))


def combined(*predictors: Predictor) -> Predictor:
    """Return the mean of log-odds, each limited to 1 : 49."""

    def predict(training: Inputs, test: Inputs) -> Array:
        odds = [logit(np.clip(p(training, test), 0.02, 0.98)) for p in predictors]
        return np.asarray(expit(np.mean(odds, axis=0)))

    return predict


def corrected(predictor: Predictor) -> Predictor:
    """Return the prediction corrected by isotonic regression on folds of the training trials left out in turn."""

    def predict(training: Inputs, test: Inputs) -> Array:
        every = np.arange(len(training.center))
        folds = [every[k::FOLDS] for k in range(FOLDS)]
        p = [predictor(training.take(np.setdiff1d(every, fold)), training.take(fold)) for fold in folds]
        return _calibrate(np.concatenate(p), training.touched[np.concatenate(folds)], predictor(training, test))

    return predict


def _calibrate(score: Array, touched: Mask, new_score: Array) -> Array:
    """Probabilities of new scores by isotonic regression of outcomes on scores."""
    regression = IsotonicRegression(out_of_bounds="clip").fit(score.ravel(), touched.ravel())
    return np.asarray(regression.predict(new_score.ravel())).reshape(new_score.shape)


METHODS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map": by_map,
    "R's map, corrected": corrected(by_map),
    "fine map, corrected": corrected(by_fine_map),
    "displacement": by_displacement,
    "landing point": by_landing,
    "fine map, displacement, landing, corrected": corrected(combined(by_fine_map, by_displacement, by_landing)),
}


def landing_gap(trial: Trial, radius_m: float, horizon_s: float) -> Array:
    """(taxels,) m from each taxel to the surface of an object of that radius where its path, continued straight
    `horizon_s` before the end, first meets one of them, or comes nearest; inf where no path was known."""
    known = np.flatnonzero((trial.stamps_s <= trial.stamps_s[-1] - horizon_s + 1e-9) & np.isfinite(trial.d_m[:, 0, 0]))
    if len(known) < 2:
        return np.full(trial.d_m.shape[1], np.inf)
    before, last = known[-3:][[0, -1]]
    v = (trial.d_m[last] - trial.d_m[before]) / (trial.stamps_s[last] - trial.stamps_s[before])
    gaps = np.linalg.norm(trial.d_m[last] + _AHEAD_S[:, None, None] * v, axis=2) - radius_m
    nearest = gaps.min(axis=1)
    landed: Array = gaps[(nearest <= 0).argmax() if (nearest <= 0).any() else nearest.argmin()]
    return landed
