"""Contact model: the probability that an approach touches a taxel, from the displacement of its path.

D and TTC (R eqs 1–2) do not distinguish a path over this taxel from one over its neighbour, 2–3 cm beside it; the
displacement from the taxel does.  Touching and missing paths are taken for Gaussian with one covariance for all taxels,
and each taxel counts its touches and misses, so that the log-odds of touch are

    log(n⁺/n⁻) + (u − m)ᵀ Σ⁻¹ δ

with the displacement u, the midpoint m between touching and missing paths, and their difference δ.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, expit

from learning.pps.trials import Trial
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask


@dataclass(frozen=True)
class ContactParams:
    """What a prediction uses, and the priors.  Each taxel starts with half a touch and half a miss (Jeffreys)."""

    horizon_s: float = 0.15
    """How long before a trial's end the last known sample is."""
    samples: int = 3
    """Number of last known samples whose displacements are averaged."""
    reach_m: float = 0.20
    """Greatest distance of a sample from the taxel (R's receptive field)."""
    toward: float = 0.5
    """Prior of δ: the way from the taxel's mean path to where touches happen, times this."""
    prior_trials: float = 5.0
    """Number of trials that the prior of δ is worth."""
    offset_m: float = 0.012
    """Standard deviation, each axis, of a session's offset (R Fig 8: mean offsets of 1.2–2.1 cm)."""
    outlier_sigmas: float = 3.0
    """A path farther than this from m has the weight of one at this distance."""
    level: float = 0.9
    """Of the credible interval."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.horizon_s) and self.horizon_s >= 0):
            raise InputError("contact", f"a horizon of {self.horizon_s} s: expected 0 or more")
        if not (self.samples >= 1 and self.prior_trials > 0 and self.offset_m > 0 and 0 < self.level < 1):
            raise InputError(
                "contact", f"{self}: expected samples, prior trials and an offset above 0, a level between 0 and 1"
            )


@dataclass(frozen=True)
class ContactModel:
    """What n taxels have learned."""

    touched: Array
    """(n,) number of trials in reach that touched the taxel, plus ½."""
    missed: Array
    """(n,) number of trials in reach that did not, plus ½."""
    any_touched: Array
    """(n,) number of all trials that touched the taxel, plus ½."""
    any_missed: Array
    """(n,) number of all trials that did not, plus ½."""
    middle: Array
    """(n, 3) m, mean displacement of all paths; NaN where none was in reach."""
    difference: Array
    """(n, 3) m, δ: mean displacement of touching minus missing paths; NaN where none was in reach."""
    trials: Array
    """(n,) number of trials that δ is worth, its prior's included."""
    precision: Array
    """(3, 3) 1/m², Σ⁻¹."""
    usual: Array
    """(3,) m, mean over trials of the displacement from the mean of the taxels."""
    usual_var: Array
    """(3,) m², its variance over trials."""
    seen: int
    """Number of those trials."""


@dataclass(frozen=True)
class ContactPrediction:
    """(trials, taxels) each."""

    probability: Array
    """Of touch; where the path was not in reach, the taxel's rate of touch over all trials."""
    lower: Array
    """Lower end of its credible interval."""
    upper: Array
    """Upper end."""
    in_reach: Mask
    """Whether the path, and some path learned from, came within reach by the horizon."""


def displacements(params: ContactParams, trials: tuple[Trial, ...]) -> Array:
    """(trials, taxels, 3) mean displacement from the taxel over the last samples known; NaN without any."""
    return np.array([[_last(params, trial, d) for d in trial.d_m.swapaxes(0, 1)] for trial in trials])


def _last(params: ContactParams, trial: Trial, d: Array) -> Array:
    known = trial.stamps_s <= trial.stamps_s[-1] - params.horizon_s + 1e-9
    near = d[known & (np.einsum("ij,ij->i", d, d) <= params.reach_m**2)]  # False for NaN
    last: Array = near[-params.samples :].mean(axis=0) if len(near) else np.full(3, np.nan)
    return last


def learn_contact(params: ContactParams, trials: tuple[Trial, ...]) -> ContactModel:
    """The contact model of some trials, whatever their order."""
    return _fit(params, displacements(params, trials), np.array([trial.touched for trial in trials]))


def predict_contact(params: ContactParams, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """Predict the touches of trials of the same session."""
    return _predict(params, learned, displacements(params, trials))


def predict_session(params: ContactParams, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """Predict the touches of another session, trial by trial in their order.

    Its kinematics and cameras have another offset, estimated from the paths of this and earlier trials alone: the
    posterior mean of their difference from the usual displacement, prior N(0, offset_m²).
    """
    u = displacements(params, trials)
    return _predict(params, learned, u - _shifts(params, learned, u)[:, None])


def _shifts(params: ContactParams, learned: ContactModel, u: Array) -> Array:
    """(trials, 3) m, the session's offset as estimated at each of its trials; zeros before any came near."""
    near: Mask = np.asarray(np.isfinite(u[..., 0]).all(axis=1))  # the mean of some taxels only is another place's
    aside = np.where(near[:, None], u.mean(axis=1) - learned.usual, 0.0)
    n = np.maximum(np.cumsum(near), 1)[:, None]
    variance = learned.usual_var * (1 / n + 1 / max(learned.seen, 1))
    shifts: Array = params.offset_m**2 / (params.offset_m**2 + variance) * np.cumsum(aside, axis=0) / n
    return shifts if learned.seen > 1 else np.zeros_like(shifts)


def _fit(params: ContactParams, u: Array, touched: Mask) -> ContactModel:
    seen: Mask = ~np.isnan(u[..., 0])
    at = np.where(seen[..., None], u, 0.0)
    kinds = touched & seen, ~touched & seen
    n = [kind.sum(axis=0) for kind in kinds]
    means = [np.einsum("tk,tkc->kc", kind, at) / np.maximum(m, 1)[:, None] for kind, m in zip(kinds, n, strict=True)]
    total = n[0] + n[1]
    positive, negative = n[0] + 0.5, n[1] + 0.5
    middle = (n[0][:, None] * means[0] + n[1][:, None] * means[1]) / np.where(total > 0, total, np.nan)[:, None]
    # Prior of δ: from each taxel's mean path towards where touches happen at all.
    near = total > 0
    rate = np.where(near, positive / (positive + negative), 0.0)
    touching = rate @ np.where(near[:, None], middle, 0.0) / max(rate.sum(), 1e-9)
    paired = (n[0] * n[1] / np.maximum(total, 1))[:, None]  # trials that the difference of two means is worth
    believed = params.toward * (touching - middle)
    difference = (paired * (means[0] - means[1]) + params.prior_trials * believed) / (paired + params.prior_trials)
    rest = at - np.where(touched[..., None], *means)
    freedom = max(int(np.maximum(n[0] - 1, 0).sum() + np.maximum(n[1] - 1, 0).sum()), 1)
    scatter = np.einsum("tk,tki,tkj->ij", seen, rest, rest) / freedom + params.offset_m**2 * np.eye(3)
    behind = paired[:, 0] + params.prior_trials
    of_all = at[seen.all(axis=1)].mean(axis=1)
    usual = of_all.mean(axis=0) if len(of_all) else np.zeros(3)
    usual_var = of_all.var(axis=0, ddof=1) if len(of_all) > 1 else np.zeros(3)
    of_any = touched.sum(axis=0) + 0.5, (~touched).sum(axis=0) + 0.5
    precision = np.linalg.inv(scatter)
    return ContactModel(
        positive, negative, *of_any, middle, difference, behind, precision, usual, usual_var, len(of_all)
    )


def _predict(params: ContactParams, learned: ContactModel, u: Array) -> ContactPrediction:
    skew = 0.5 * (learned.missed - learned.touched) / (learned.missed + learned.touched)
    aside = u - (learned.middle + skew[:, None] * learned.difference)  # u − m
    in_reach: Mask = ~np.isnan(aside[..., 0])
    aside = np.where(in_reach[..., None], aside, 0.0)
    positive = np.where(in_reach, learned.touched, learned.any_touched)
    negative = np.where(in_reach, learned.missed, learned.any_missed)
    sigmas = np.sqrt(np.einsum("tki,ij,tkj->tk", aside, learned.precision, aside))
    kept = np.minimum(1.0, params.outlier_sigmas / np.maximum(sigmas, 1e-9))
    difference = np.where(np.isfinite(learned.difference), learned.difference, 0.0)
    odds = np.log(positive / negative) + kept * np.einsum("tki,ij,kj->tk", aside, learned.precision, difference)
    probability = expit(odds)
    rate = positive / (positive + negative)
    variance = 1 / (positive * (1 - rate)) + (kept * sigmas) ** 2 / learned.trials  # of the log-odds
    worth = 1 / (variance * probability * (1 - probability))  # trials of a Beta distribution with this variance
    tails = 0.5 * (1 - params.level), 0.5 * (1 + params.level)
    lower, upper = (betaincinv(worth * probability, worth * (1 - probability), tail) for tail in tails)
    return ContactPrediction(probability, lower, upper, in_reach)
