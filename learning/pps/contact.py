"""Whether an approach will touch a taxel: how often it is touched, and where paths that touch it pass.

D and TTC (R eqs 1–2) do not tell a path over this taxel from one over its neighbour, 2–3 cm beside.  The
third dimension does: where the stimulus is, seen from the taxel.  A map of bins would need hundreds of
trials, so what they would hold is described by few numbers: how often each taxel is touched (beta counts), by how much
touching paths are displaced from the others, and one scatter for all taxels.  Both kinds of path being Gaussian, the
log-odds of touch are those of the counts plus a straight line in the displacement.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, expit

from learning.pps.trials import Trial
from pps_vision.types import Array, Mask

_AHEAD_S = np.arange(0.0, 0.6, 0.01)  # how far a path is continued


@dataclass(frozen=True)
class ContactParams:
    """When a touch is predicted, from what, and what is believed before the first trial.

    `horizon_s` before the trial's end is the last moment known; of the samples until then the last
    `samples` within `reach_m` (R's receptive field) count.  Beliefs: touched paths pass nearer to this taxel
    than to its neighbours by `toward` of the way, as surely as `prior_trials` trials would say;
    half a touch and half a miss on each taxel (Jeffreys).  `offset_m`: how far a session's kinematics and
    cameras may be off another's, each axis (the least of R Fig 8's mean offsets, 1.2 to 2.1 cm).  A path
    further than `outlier_sigmas` from all others says no more than one at that distance.  `level` of the
    credible interval.
    """

    horizon_s: float = 0.15
    samples: int = 3
    reach_m: float = 0.20
    toward: float = 0.5
    prior_trials: float = 5.0
    offset_m: float = 0.012
    outlier_sigmas: float = 3.0
    level: float = 0.9

    def __post_init__(self) -> None:
        if not (np.isfinite(self.horizon_s) and self.horizon_s >= 0):
            raise ValueError(f"a horizon of {self.horizon_s} s: expected 0 or more")
        if not (self.samples >= 1 and self.prior_trials > 0 and self.offset_m > 0 and 0 < self.level < 1):
            raise ValueError(f"{self}: expected samples, prior trials and an offset above 0, a level between 0 and 1")


@dataclass(frozen=True)
class ContactModel:
    """What n taxels have learned: `touched`, `missed` (n,) counts of trials that came near, `any_touched`, `any_missed`
    of all, the prior's half each included; displacement of all paths `middle` (n, 3) and of touched from missed ones
    `difference` (n, 3), m, NaN where nothing came near; `trials` (n,) behind that difference; `precision` (3, 3), 1/m².
    Of each trial's displacement from the mean of the taxels: `usual` (3,) and `usual_var` (3,), mean and variance, of
    `seen` trials."""

    touched: Array
    missed: Array
    any_touched: Array
    any_missed: Array
    middle: Array
    difference: Array
    trials: Array
    precision: Array
    usual: Array
    usual_var: Array
    seen: int


@dataclass(frozen=True)
class ContactPrediction:
    """(trials, taxels) each: probability of touch, its credible interval, and whether the path was in reach in time, as
    some that were learned from; where not, the probability is the taxel's rate of touch over all trials."""

    probability: Array
    lower: Array
    upper: Array
    in_reach: Mask


def displacements(params: ContactParams, trials: tuple[Trial, ...]) -> Array:
    """(trials, taxels, 3) mean displacement from the taxel over the last samples known; NaN without any."""
    return np.array([[_last(params, trial, d) for d in trial.d_m.swapaxes(0, 1)] for trial in trials])


def _last(params: ContactParams, trial: Trial, d: Array) -> Array:
    known = trial.stamps_s <= trial.stamps_s[-1] - params.horizon_s + 1e-9
    near = d[known & (np.einsum("ij,ij->i", d, d) <= params.reach_m**2)]  # False for NaN
    last: Array = near[-params.samples :].mean(axis=0) if len(near) else np.full(3, np.nan)
    return last


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


def learn_contact(params: ContactParams, trials: tuple[Trial, ...]) -> ContactModel:
    """The map of some trials, in no matter what order."""
    return _fit(params, displacements(params, trials), np.array([trial.touched for trial in trials]))


def predict_contact(params: ContactParams, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """What a map expects of other trials."""
    return _expect(params, learned, displacements(params, trials))


def predict_session(params: ContactParams, learned: ContactModel, trials: tuple[Trial, ...]) -> ContactPrediction:
    """What a map expects of the trials, in their order, of another session, whose kinematics and cameras are off by
    something else.

    By how much is learned from the paths alone, a trial's own and those before it: the difference of their mean to
    the usual one, as far as `offset_m` and the paths' own variance let it be believed.
    """
    u = displacements(params, trials)
    return _expect(params, learned, u - _shifts(params, learned, u)[:, None])


def _shifts(params: ContactParams, learned: ContactModel, u: Array) -> Array:
    """(trials, 3) m by which a session is displaced, as known by each of its trials; zeros before any came near."""
    near: Mask = np.asarray(np.isfinite(u[..., 0]).all(axis=1))  # the mean of some taxels only is another place's
    aside = np.where(near[:, None], u.mean(axis=1) - learned.usual, 0.0)
    n = np.maximum(np.cumsum(near), 1)[:, None]
    doubt = learned.usual_var * (1 / n + 1 / max(learned.seen, 1))
    shifts: Array = params.offset_m**2 / (params.offset_m**2 + doubt) * np.cumsum(aside, axis=0) / n
    return shifts if learned.seen > 1 else np.zeros_like(shifts)


def leave_one_out(params: ContactParams, trials: tuple[Trial, ...]) -> ContactPrediction:
    """Each trial predicted by a map of all the others."""
    u, touched = displacements(params, trials), np.array([trial.touched for trial in trials])
    parts = []
    for i in range(len(trials)):
        others = np.arange(len(trials)) != i
        parts.append(_expect(params, _fit(params, u[others], touched[others]), u[~others]))
    columns = zip(*((p.probability, p.lower, p.upper, p.in_reach) for p in parts), strict=True)
    return ContactPrediction(*(np.concatenate(column) for column in columns))


def _fit(params: ContactParams, u: Array, touched: Mask) -> ContactModel:
    seen: Mask = ~np.isnan(u[..., 0])
    at = np.where(seen[..., None], u, 0.0)
    kinds = touched & seen, ~touched & seen
    n = [kind.sum(axis=0) for kind in kinds]
    means = [np.einsum("tk,tkc->kc", kind, at) / np.maximum(m, 1)[:, None] for kind, m in zip(kinds, n, strict=True)]
    total = n[0] + n[1]
    positive, negative = n[0] + 0.5, n[1] + 0.5
    middle = (n[0][:, None] * means[0] + n[1][:, None] * means[1]) / np.where(total > 0, total, np.nan)[:, None]
    # Where touches happen at all, seen from each taxel: what lies on its side of that is more likely to be its own.
    near = total > 0
    rate = np.where(near, positive / (positive + negative), 0.0)
    touching = rate @ np.where(near[:, None], middle, 0.0) / max(rate.sum(), 1e-9)
    paired = (n[0] * n[1] / np.maximum(total, 1))[:, None]  # so many trials the difference of two means is worth
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


def _expect(params: ContactParams, learned: ContactModel, u: Array) -> ContactPrediction:
    lean = 0.5 * (learned.missed - learned.touched) / (learned.missed + learned.touched)
    aside = u - (learned.middle + lean[:, None] * learned.difference)  # from half-way between touched and missed
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
    worth = 1 / (variance * probability * (1 - probability))  # trials that would leave this much doubt
    tails = 0.5 * (1 - params.level), 0.5 * (1 + params.level)
    lower, upper = (betaincinv(worth * probability, worth * (1 - probability), tail) for tail in tails)
    return ContactPrediction(probability, lower, upper, in_reach)
