"""Ways to predict which taxels a recorded approach will touch: the paper's map, what was made of it, and ours.

A `Method` is given trials and a horizon and returns a function that learns from some of the trials, by their
numbers, and gives the probability of touch (m, taxels) of others.  What a map does not cover is given the
taxel's rate of touch.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from learning.pps.trials import Trial
from pps_vision.types import Array, Mask

Numbers = NDArray[np.intp]
Predictor = Callable[[Numbers, Numbers], Array]
Method = Callable[[tuple[Trial, ...], float], Predictor]
Reference = Literal["taxel", "surface", "landing"]

UP = np.array([0.0, 0.0, 1.0])
RADIUS_M = 0.03  # of the objects, roughly: the data do not tell
_EVERYWHERE = ReceptiveField(base_radius_m=10.0)  # a path measured from its end has no cone


def base_rate(trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
    """How often each taxel was touched, whatever the path."""
    touched = _touched(trials)
    return lambda train, test: np.tile(touched[train].mean(axis=0), (len(test), 1))


@dataclass(frozen=True)
class Passing:
    """Ours; `flat` sees displacements along the skin only."""

    params: ContactParams = field(default_factory=ContactParams)
    flat: bool = False

    def __call__(self, trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
        """See the module."""
        params = replace(self.params, horizon_s=horizon_s)
        if self.flat:
            trials = tuple(replace(trial, d_m=trial.d_m * np.array([1.0, 1.0, 0.0])) for trial in trials)

        def predict(train: Numbers, test: Numbers) -> Array:
            learned = learn_contact(params, tuple(trials[i] for i in train))
            return predict_contact(params, learned, tuple(trials[i] for i in test)).probability

        return predict


@dataclass(frozen=True)
class Plain:
    """R's map of 8 × 4 bins of D and TTC, read at the last sample known or averaged over all of them.

    D is measured from the taxel's centre, from the stimulus's surface (a sphere of `RADIUS_M`), or from where paths
    land: each path's own end where it is learned, their mean where one is predicted, whose end is not yet known.
    """

    ttc_s: float = 1.2
    sigma_bins: float = 0.75
    reference: Reference = "taxel"
    average: bool = True

    def __call__(self, trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
        """See the module."""
        touched = _touched(trials)
        ends = np.array([trial.d_m[-1] for trial in trials])
        memory = MemoryParams(ttc_range_s=(0.0, self.ttc_s), sigma_bins=self.sigma_bins)
        n = touched.shape[1]
        blank = PPSMemory(
            tuple(map(str, range(n))), np.zeros(n, np.intp), np.zeros((n, *memory.bins, 2), np.int64), memory
        )
        learned = np.array([
            count_samples(blank, *self._perceived(trial, end), now).counts
            for trial, end, now in zip(trials, ends, touched, strict=True)
        ])  # fmt: skip

        def predict(train: Numbers, test: Numbers) -> Array:
            full = replace(blank, counts=learned[train].sum(axis=0))
            usual = ends[train].mean(axis=0)
            p = np.array([self._read(full, known(trials[i], horizon_s), usual) for i in test])
            return np.where(np.isnan(p), touched[train].mean(axis=0), p)

        return predict

    def _perceived(self, trial: Trial, end: Array) -> tuple[Array, Array]:
        if self.reference == "landing":
            return distance_and_ttc(_EVERYWHERE, trial.d_m - end, UP, trial.v_m_s)
        return distance_and_ttc(
            ReceptiveField(subtract_radius=self.reference == "surface"), trial.d_m, UP, trial.v_m_s, RADIUS_M
        )

    def _read(self, memory: PPSMemory, trial: Trial, usual_end: Array) -> Array:
        D, ttc = self._perceived(trial, usual_end)
        inside = memory.params.covers(D, ttc)
        if not self.average:
            inside &= np.cumsum(inside[::-1], axis=0)[::-1] == 1  # the last one
        return _mean_where(activation(memory, D, ttc), inside)


@dataclass(frozen=True)
class Shrunk:
    """Bins of D, TTC and, with `lateral_bins` above 1, lateral distance, in which a trial counts once however long
    it stays; each taxel's rate of touch counts as `prior` trials more, its neighbours' trials as `pooled` each."""

    lateral_bins: int = 1
    prior: float = 2.0
    pooled: float = 0.0
    sigma_bins: float = 0.75

    def __call__(self, trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
        """See the module."""
        touched = _touched(trials)
        windows = [self._windows(known(trial, horizon_s)) for trial in trials]
        weights = np.array([w.sum(axis=0) / np.maximum(w.sum(axis=(0, 2)), 1e-9)[:, None] for w in windows])

        def predict(train: Numbers, test: Numbers) -> Array:
            rate = (touched[train].sum(axis=0) + 0.5) / (len(train) + 1)
            seen = weights[train].sum(axis=0)
            hit = np.einsum("tkb,tk->kb", weights[train], touched[train])
            bins = seen.shape[1]
            # in units of a bin's fair share, so that the prior weighs the same however fine the bins
            seen, hit = bins * self._with_neighbours(seen), bins * self._with_neighbours(hit)
            p = np.array([self._read(windows[i], seen, hit, rate) for i in test])
            return np.where(np.isnan(p), rate, p)

        return predict

    def _with_neighbours(self, counts: Array) -> Array:
        pooled: Array = counts + self.pooled * (counts.sum(axis=0) - counts)
        return pooled

    def _read(self, window: Array, seen: Array, hit: Array, rate: Array) -> Array:
        n, positive = (np.einsum("tkb,kb->tk", window, counts) for counts in (seen, hit))
        return _mean_where((self.prior * rate + positive) / (self.prior + n), window.sum(axis=-1) > 0.5)

    def _windows(self, trial: Trial) -> Array:
        """(T, n, bins) Parzen weights of every sample, adding up to 1 where the map covers it, 0 elsewhere."""
        D, ttc = distance_and_ttc(ReceptiveField(), trial.d_m, UP, trial.v_m_s)
        lateral = np.minimum(np.linalg.norm(trial.d_m[..., :2], axis=-1), 0.08)  # the last bin has no end
        window = np.ones((*D.shape, 1))
        for value, low, high, n in ((D, -0.1, 0.2, 8), (ttc, 0.0, 1.2, 4), (lateral, 0.0, 0.08, self.lateral_bins)):
            inside = (value >= low) & (value <= high)
            at = (np.where(inside, value, low) - low) / (high - low) * n
            bell = np.exp(-0.5 * ((at[..., None] - np.arange(n) - 0.5) / self.sigma_bins) ** 2)
            bell *= inside[..., None] / bell.sum(axis=-1, keepdims=True)
            window = (window[..., :, None] * bell[..., None, :]).reshape(*D.shape, -1)
        return window


@dataclass(frozen=True)
class Kernel:
    """A Parzen window over where paths pass, in place of two Gaussians: each taxel's rate as `prior` trials
    more, its neighbours' trials as `pooled` each."""

    sigma_m: float = 0.016
    prior: float = 2.0
    pooled: float = 0.0

    def __call__(self, trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
        """See the module."""
        touched = _touched(trials)
        u = np.array([known(trial, horizon_s).d_m[-3:].mean(axis=0) for trial in trials])

        def predict(train: Numbers, test: Numbers) -> Array:
            rate = (touched[train].sum(axis=0) + 0.5) / (len(train) + 1)
            apart = u[test][:, None, :, None] - u[train][None, :, None, :]  # test, train, own taxel, whose trial
            near = np.exp(-0.5 * (apart**2).sum(axis=-1) / self.sigma_m**2)
            near = near * (self.pooled + (1 - self.pooled) * np.eye(u.shape[1]))
            p: Array = (self.prior * rate + np.einsum("abkj,bj->ak", near, touched[train])) / (
                self.prior + near.sum(axis=(1, 3))
            )
            return p

        return predict


def known(trial: Trial, horizon_s: float) -> Trial:
    """The trial up to a horizon before its end."""
    until = trial.stamps_s <= trial.stamps_s[-1] - horizon_s + 1e-9
    return replace(trial, stamps_s=trial.stamps_s[until], d_m=trial.d_m[until], v_m_s=trial.v_m_s[until])


def _touched(trials: tuple[Trial, ...]) -> Mask:
    return np.array([trial.touched for trial in trials])


def _mean_where(values: Array, which: Mask) -> Array:
    """(n,) mean over time (T, n); NaN where nothing is chosen."""
    n = which.sum(axis=0)
    return np.where(n > 0, np.where(which, values, 0.0).sum(axis=0) / np.maximum(n, 1), np.nan)


METHODS: Mapping[str, Method] = {
    "base rate": base_rate,
    "R's map, last sample": Plain(average=False),
    "R's map, all samples": Plain(),
    "D×TTC, shrunk": Shrunk(),
    "D×TTC, shrunk, pooled": Shrunk(pooled=0.3),
    "D×TTC×lateral, shrunk": Shrunk(lateral_bins=4),
    "D×TTC×lateral, shrunk, pooled": Shrunk(lateral_bins=4, pooled=0.3),
    "displacement, Parzen": Kernel(),
    "displacement, Parzen, pooled": Kernel(pooled=0.3),
    "along the skin, Gaussian": Passing(flat=True),
    "displacement, no geometry": Passing(ContactParams(toward=0.0)),
    "displacement, Gaussian (ours)": Passing(),
}
OURS = "displacement, Gaussian (ours)"
