"""Contact model: the probability that an approach touches a taxel, from the displacement of its path.

D and TTC (R eqs 1–2) do not distinguish a path over this taxel from one over its neighbour, 2–3 cm beside it; the
displacement from the taxel does.  This is linear discriminant analysis: the displacements u of touching and of missing
paths are Gaussian about different means with one covariance Σ for all taxels, so that the log-odds of touch are

    log(n⁺/n⁻) + (u − m)ᵀ Σ⁻¹ δ

with the numbers n⁺ of touches and n⁻ of misses, the midpoint m of the two means, and their difference δ.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, expit

from learning.pps.trials import Trial
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask


@dataclass(frozen=True)
class ContactParams:
    """What a prediction uses, and the priors.

    Each taxel starts with half a touch and half a miss (Jeffreys' prior).  Where no source is given, the value was
    chosen on simulated sessions and on the authors' 37 trials (docs/peripersonal_space.md, "A real robot").
    """

    horizon_s: float = 0.15
    """Samples up to this time before a trial's end are known (the goal of the study `pps_calibration`)."""
    samples: int = 3
    """Number of last known samples whose displacements are averaged."""
    reach_m: float = 0.20
    """Greatest distance of a sample from the taxel (R's receptive field)."""
    prior_share: float = 0.5
    """Prior of δ: this share of the way from the taxel's mean path to the mean path of all touches."""
    prior_trials: float = 5.0
    """Number of trials that the prior of δ is worth."""
    offset_m: float = 0.012
    """Standard deviation, each axis, of a session's offset (R Fig 8: mean offsets of 1.2–2.1 cm)."""
    outlier_sigmas: float = 3.0
    """The term of u of a path farther than this from m is that of a path at this distance."""
    level: float = 0.9
    """Probability that the credible interval holds."""

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
    mean: Array
    """(n, 3) m, mean displacement of all paths; NaN where none was in reach."""
    difference: Array
    """(n, 3) m, δ: mean displacement of touching minus missing paths; NaN where none was in reach."""
    difference_trials: Array
    """(n,) effective number of trials that δ was estimated from, its prior's included."""
    precision: Array
    """(3, 3) 1/m², Σ⁻¹."""
    session_mean: Array
    """(3,) m, mean displacement over all taxels, of the trials in reach of all of them."""
    session_var: Array
    """(3,) m², variance over these trials of their mean displacement."""
    session_trials: int
    """Number of these trials."""


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
    posterior mean of the difference from the first session's mean displacement, prior N(0, offset_m²).
    """
    u = displacements(params, trials)
    return _predict(params, learned, u - _session_offsets(params, learned, u)[:, None])


def _session_offsets(params: ContactParams, learned: ContactModel, u: Array) -> Array:
    """(trials, 3) m, the session's offset as estimated at each of its trials; zeros before any was in reach."""
    in_reach: Mask = np.asarray(np.isfinite(u[..., 0]).all(axis=1))  # of all taxels, as for `session_mean`
    apart = np.where(in_reach[:, None], u.mean(axis=1) - learned.session_mean, 0.0)
    n = np.maximum(np.cumsum(in_reach), 1)[:, None]
    variance = learned.session_var * (1 / n + 1 / max(learned.session_trials, 1))
    offsets: Array = params.offset_m**2 / (params.offset_m**2 + variance) * np.cumsum(apart, axis=0) / n
    return offsets if learned.session_trials > 1 else np.zeros_like(offsets)


def _fit(params: ContactParams, u: Array, touched: Mask) -> ContactModel:
    """The model of displacements (trials, n, 3), NaN out of reach, and outcomes (trials, n)."""
    in_reach: Mask = ~np.isnan(u[..., 0])
    u_known = np.where(in_reach[..., None], u, 0.0)
    kinds = touched & in_reach, ~touched & in_reach
    n = [kind.sum(axis=0) for kind in kinds]
    means = [
        np.einsum("tk,tkc->kc", kind, u_known) / np.maximum(m, 1)[:, None] for kind, m in zip(kinds, n, strict=True)
    ]
    total = n[0] + n[1]
    n_touched, n_missed = n[0] + 0.5, n[1] + 0.5
    mean = (n[0][:, None] * means[0] + n[1][:, None] * means[1]) / np.where(total > 0, total, np.nan)[:, None]
    # Prior of δ: towards the mean path of all touches, each taxel weighted by its rate of touch.
    rate = np.where(total > 0, n_touched / (n_touched + n_missed), 0.0)
    mean_touching = rate @ np.where(total[:, None] > 0, mean, 0.0) / max(rate.sum(), 1e-9)
    prior = params.prior_share * (mean_touching - mean)
    effective = (n[0] * n[1] / np.maximum(total, 1))[:, None]  # trials of the difference of two means
    difference_trials = effective + params.prior_trials
    difference = (effective * (means[0] - means[1]) + params.prior_trials * prior) / difference_trials
    # Covariance of the displacements about the mean of their kind, pooled over taxels and kinds.
    residuals = u_known - np.where(touched[..., None], *means)
    freedom = max(int(np.maximum(n[0] - 1, 0).sum() + np.maximum(n[1] - 1, 0).sum()), 1)
    covariance = np.einsum("tk,tki,tkj->ij", in_reach, residuals, residuals) / freedom
    precision = np.linalg.inv(covariance + params.offset_m**2 * np.eye(3))
    of_session = u_known[in_reach.all(axis=1)].mean(axis=1)
    return ContactModel(
        touched=n_touched,
        missed=n_missed,
        any_touched=touched.sum(axis=0) + 0.5,
        any_missed=(~touched).sum(axis=0) + 0.5,
        mean=mean,
        difference=difference,
        difference_trials=difference_trials[:, 0],
        precision=precision,
        session_mean=of_session.mean(axis=0) if len(of_session) else np.zeros(3),
        session_var=of_session.var(axis=0, ddof=1) if len(of_session) > 1 else np.zeros(3),
        session_trials=len(of_session),
    )


def _predict(params: ContactParams, learned: ContactModel, u: Array) -> ContactPrediction:
    """The prediction for displacements (trials, n, 3), NaN out of reach."""
    share = 0.5 * (learned.missed - learned.touched) / (learned.missed + learned.touched)
    apart = u - (learned.mean + share[:, None] * learned.difference)  # u − m
    in_reach: Mask = ~np.isnan(apart[..., 0])
    apart = np.where(in_reach[..., None], apart, 0.0)
    touched = np.where(in_reach, learned.touched, learned.any_touched)
    missed = np.where(in_reach, learned.missed, learned.any_missed)
    sigmas = np.sqrt(np.einsum("tki,ij,tkj->tk", apart, learned.precision, apart))
    weight = np.minimum(1.0, params.outlier_sigmas / np.maximum(sigmas, 1e-9))
    difference = np.where(np.isfinite(learned.difference), learned.difference, 0.0)
    log_odds = np.log(touched / missed) + weight * np.einsum("tki,ij,kj->tk", apart, learned.precision, difference)
    probability = expit(log_odds)
    rate = touched / (touched + missed)
    variance = 1 / (touched * (1 - rate)) + (weight * sigmas) ** 2 / learned.difference_trials  # of the log-odds
    # The interval is that of a Beta distribution with this mean and variance of the log-odds.
    n = 1 / (variance * probability * (1 - probability))
    tails = 0.5 * (1 - params.level), 0.5 * (1 + params.level)
    lower, upper = (betaincinv(n * probability, n * (1 - probability), tail) for tail in tails)
    return ContactPrediction(probability, lower, upper, in_reach)
