"""Methods that predict which taxels a recorded approach of the real robot will touch.

A `Method` takes all trials and a horizon. The predictor it returns trains on some of the trials, given by their
indices, and returns probabilities (m, taxels) for others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.memory import MemoryParams, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from learning.pps.trials import Trial
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.types import Array, Mask

Indices = NDArray[np.intp]
Predictor = Callable[[Indices, Indices], Array]
Method = Callable[[tuple[Trial, ...], float], Predictor]

UP = np.array([0.0, 0.0, 1.0])
_MAP = MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75)  # of the authors' own code


def outcomes(trials: tuple[Trial, ...]) -> Mask:
    """Return what was touched (trials, taxels)."""
    return np.array([trial.touched for trial in trials])


def base_rate(trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
    """Predict how often each taxel was touched, whatever the path."""
    touched = outcomes(trials)
    return lambda train, test: np.tile(touched[train].mean(axis=0), (len(test), 1))


def r_map(trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
    """Predict R's activation, averaged over the samples known; the base rate where the map covers none."""
    touched = outcomes(trials)
    empty = empty_map(touched.shape[1], _MAP)
    perceived = [distance_and_ttc(ReceptiveField(), trial.d_m, UP, trial.v_m_s) for trial in trials]
    counts = np.array([
        count_samples(empty, *samples, now).counts for samples, now in zip(perceived, touched, strict=True)
    ])  # fmt: skip

    def predict(train: Indices, test: Indices) -> Array:
        memory = replace(empty, counts=counts[train].sum(axis=0))
        p = []
        for i in test:
            known = trials[i].stamps_s <= trials[i].stamps_s[-1] - horizon_s + 1e-9
            D, TTC = (samples[known] for samples in perceived[i])
            covered = _MAP.covers(D, TTC)
            total = np.where(covered, activation(memory, D, TTC), 0.0).sum(axis=0)
            p.append(np.where(covered.any(axis=0), total / np.maximum(covered.sum(axis=0), 1), np.nan))
        return np.where(np.isnan(p), touched[train].mean(axis=0), p)

    return predict


@dataclass(frozen=True)
class Displacement:
    """Predict from where the path passes each taxel (`learning/pps/contact.py`); `flat`: only along the skin."""

    params: ContactParams = ContactParams()
    flat: bool = False

    def __call__(self, trials: tuple[Trial, ...], horizon_s: float) -> Predictor:
        """Return the predictor."""
        params = replace(self.params, horizon_s=horizon_s)
        if self.flat:
            trials = tuple(replace(trial, d_m=trial.d_m * np.array([1.0, 1.0, 0.0])) for trial in trials)

        def predict(train: Indices, test: Indices) -> Array:
            learned = learn_contact(params, tuple(trials[i] for i in train))
            return predict_contact(params, learned, tuple(trials[i] for i in test)).probability

        return predict


OURS = "displacement (ours)"
METHODS: Mapping[str, Method] = {
    "base rate": base_rate,
    "R's map": r_map,
    "displacement along the skin": Displacement(flat=True),
    OURS: Displacement(),
}


def leave_one_out(method: Method, trials: tuple[Trial, ...], horizon_s: float) -> Array:
    """Return probabilities (trials, taxels), each trial predicted from all others."""
    return in_blocks(method, trials, horizon_s, len(trials))


def in_blocks(method: Method, trials: tuple[Trial, ...], horizon_s: float, blocks: int) -> Array:
    """Return probabilities (trials, taxels), each block of consecutive trials predicted from the others."""
    predict, every = method(trials, horizon_s), np.arange(len(trials))
    return np.concatenate([predict(np.setdiff1d(every, block), block) for block in np.array_split(every, blocks)])
