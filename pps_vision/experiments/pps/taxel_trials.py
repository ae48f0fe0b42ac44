"""Trials in the frames of the taxels, and the authors' files of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.archive import named, read_arrays
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask

_SAMPLE_PERIOD_S = 0.1  # of the released, resampled positions and velocities
_ARRAYS = ("position_m", "velocity_m_s", "offsets", "outcome")


@dataclass(frozen=True)
class Trial:
    """One approach to n taxels, T samples; NaN while the object is unknown."""

    stamps_s: Array
    """(T,)"""
    d_m: Array
    """(T, n, 3) displacement from taxel to object in the taxel's frame, z along its normal."""
    v_m_s: Array
    """(T, n, 3) velocity of the object relative to the taxel, in the taxel's frame."""
    touched: Mask
    """(n,) which taxels were touched at the end."""
    radius_m: float = 0.0
    """Radius of the object."""
    velocity_covs: Array | None = None
    """(T, n, 3, 3) m²/s², covariance of `v_m_s`; None where it is not known."""


def touch_rates(trials: tuple[Trial, ...]) -> Array:
    """(n,) share of the trials in which each taxel was touched."""
    rates: Array = np.mean([trial.touched for trial in trials], axis=0)
    return rates


def load_trials(path: Path) -> tuple[Trial, ...]:
    """Read a file of the authors' trials; samples that are not finite become NaN.

    The rows of `position_m` and `velocity_m_s` (m, 3) follow each other by trial and taxel; those of pair k are
    `offsets[k]` to `offsets[k + 1]`. `outcome` (trials, taxels) is 1 (touched) or -1.
    """
    data = named(path, read_arrays(path, "trials", _ARRAYS), _ARRAYS, "trials")
    outcome = data["outcome"].astype(np.int64)
    offsets = data["offsets"].astype(np.int64)
    if outcome.ndim != 2 or offsets.shape != (outcome.size + 1,):
        shapes = f"outcome of shape {outcome.shape}, offsets of shape {offsets.shape}"
        raise InputError(path, f"{shapes}; expected (trials, taxels) and one offset more than pairs")
    lengths = np.diff(offsets).reshape(outcome.shape)
    if np.any(lengths != lengths[:, :1]):
        raise InputError(path, "taxels of one trial with different numbers of samples; expected the same number")
    n_taxels = outcome.shape[1]
    trials = []
    for touched, start, end in zip(outcome > 0, offsets[:-1:n_taxels], offsets[n_taxels::n_taxels], strict=True):
        samples = np.stack([data[name][start:end] for name in _ARRAYS[:2]]).astype(np.float64)
        samples[~np.isfinite(samples)] = np.nan
        d_m, v_m_s = samples.reshape(2, n_taxels, -1, 3).swapaxes(1, 2)
        trials.append(Trial(_SAMPLE_PERIOD_S * np.arange(len(d_m)), d_m, v_m_s, touched))
    return tuple(trials)
