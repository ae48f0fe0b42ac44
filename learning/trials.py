"""Predicting contact on recorded trials: learn from all trials but one, predict that one, for every trial.

Trials are those of the authors' released data: an object approaches four taxels of a real robot.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from learning.archive import UNREADABLE
from learning.buffer import BufferParams, EventBuffer, resample
from learning.memory import MemoryParams, PPSMemory, activation, learn
from learning.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.types import Array, Mask, TaxelEvents

SAMPLE_PERIOD_S = 0.1  # of the released, resampled positions and velocities
_ARRAYS = ("position_m", "velocity_m_s", "offsets", "outcome")


@dataclass(frozen=True)
class Trial:
    """One approach: displacements from the taxels `d_m` and velocities `v_m_s` (T, n, 3) in the taxels'
    frames (z is the normal), and which taxels were touched at its end (n,)."""

    stamps_s: Array
    d_m: Array
    v_m_s: Array
    touched: Mask


@dataclass(frozen=True)
class PredictionParams:
    """The learner as its authors ran it on these data (TTC up to 1.2 s, window of 0.75 bins, FACTS §3);
    a prediction uses what was known `lead_s` before the trial's end."""

    receptive_field: ReceptiveField = field(default_factory=ReceptiveField)
    buffer: BufferParams = field(default_factory=BufferParams)
    memory: MemoryParams = field(default_factory=lambda: MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75))
    lead_s: float = 0.15


@dataclass(frozen=True)
class Predictions:
    """(trials, taxels) each: predicted probability of touch, the taxel's rate of touch in the other
    trials, and what happened."""

    probability: Array
    base_rate: Array
    touched: Mask


def load_trials(path: Path) -> tuple[Trial, ...]:
    """Read a trials file; ValueError names the file and what is wrong with it."""
    try:
        with np.load(path) as file:
            data = {name: file[name] for name in _ARRAYS}
    except UNREADABLE as error:
        raise ValueError(f"{path}: expected an .npz file with {', '.join(_ARRAYS)}") from error
    n_trials, n_taxels = data["outcome"].shape
    starts = data["offsets"]
    if len(starts) != n_trials * n_taxels + 1:
        raise ValueError(f"{path}: {len(starts)} offsets, expected {n_trials * n_taxels + 1}")
    lengths = np.diff(starts).reshape(n_trials, n_taxels)
    if not np.all(lengths == lengths[:, :1]):
        raise ValueError(f"{path}: the taxels of one trial have different lengths, expected one")
    trials = []
    for i in range(n_trials):
        rows = slice(starts[i * n_taxels], starts[(i + 1) * n_taxels])
        d, v = (data[name][rows].reshape(n_taxels, -1, 3).swapaxes(0, 1) for name in _ARRAYS[:2])
        trials.append(Trial(SAMPLE_PERIOD_S * np.arange(len(d)), d, v, data["outcome"][i] > 0))
    return tuple(trials)


def perceived(params: PredictionParams, trial: Trial) -> EventBuffer:
    """The buffer at the end of a trial."""
    D, TTC = distance_and_ttc(params.receptive_field, trial.d_m, np.array([0.0, 0.0, 1.0]), trial.v_m_s)
    taxel_ids = tuple(str(i) for i in range(len(trial.touched)))
    recent = np.flatnonzero(trial.stamps_s >= trial.stamps_s[-1] - params.buffer.length_s)
    nothing = np.zeros_like(trial.touched)
    samples = tuple(TaxelEvents(float(trial.stamps_s[i]), taxel_ids, D[i], TTC[i], nothing) for i in recent)
    return EventBuffer(params.buffer, samples)


def leave_one_out(params: PredictionParams, trials: tuple[Trial, ...]) -> Predictions:
    """Each trial predicted by a memory of all the others."""
    buffers = [perceived(params, trial) for trial in trials]
    touched = np.array([trial.touched for trial in trials])
    n_taxels = touched.shape[1]
    ids = tuple(str(i) for i in range(n_taxels))
    blank = PPSMemory(
        ids, np.zeros(n_taxels, np.intp), np.zeros((n_taxels, *params.memory.bins, 2), np.int64), params.memory
    )
    learned = [learn(blank, buffer, touch).counts for buffer, touch in zip(buffers, touched, strict=True)]
    everything = np.sum(learned, axis=0)
    base_rate = (touched.sum(axis=0) - touched) / (len(trials) - 1)
    probability = base_rate.copy()
    for i, buffer in enumerate(buffers):
        pooled = predict(params, replace(blank, counts=everything - learned[i]), buffer)
        probability[i] = np.where(np.isnan(pooled), base_rate[i], pooled)
    return Predictions(probability, base_rate, touched)


def predict(params: PredictionParams, memory: PPSMemory, buffer: EventBuffer) -> Array:
    """(n,) mean activation over all samples known `lead_s` before the buffer's end that lie within
    the ranges of the memory; NaN for a taxel that has none.

    The mean, because every sample bears on the same question and its velocity is noisy.
    """
    known = buffer.samples[-1].stamp_s - params.lead_s
    D, TTC = resample(replace(buffer, samples=tuple(s for s in buffer.samples if s.stamp_s <= known)))
    inside = memory.params.covers(D, TTC)
    n = inside.sum(axis=0)
    return np.where(n > 0, activation(memory, D, TTC).sum(axis=0) / np.maximum(n, 1), np.nan)
