"""Trials: an object approaches the skin and touches some taxels at the end.

A `TouchTrial` is in the robot's root frame, a `Trial` in the taxels' own frames. Files of trials have the layout of the
authors' released data.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learning.archive import named, read_arrays
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask

_SAMPLE_PERIOD_S = 0.1  # of the released, resampled positions and velocities
_ARRAYS = ("position_m", "velocity_m_s", "offsets", "outcome")


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """T samples of a robot and an object, from the start of a movement to its touch or its end; NaN while the object is
    unknown."""

    stamps_s: Array
    """(T,)"""
    joints_rad: Array
    """(T, k) all joints of the robot."""
    positions: Array
    """(T, 3) m, root frame: centre of the object."""
    velocities: Array
    """(T, 3) m/s, root frame."""
    velocity_covs: Array
    """(T, 3, 3) m²/s²."""
    radius_m: Array
    """(T,)"""
    touched: Mask
    """(n,) taxels of the skin that were touched at the end."""


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
    """Read a trials file, infinite samples as NaN; InputError names the file and what was expected."""
    data = named(path, read_arrays(path, "trials", _ARRAYS), _ARRAYS, "trials")
    _check(path, data)
    outcome, starts = data["outcome"], data["offsets"].astype(np.int64)
    n_trials, n_taxels = outcome.shape
    lengths = np.diff(starts).reshape(n_trials, n_taxels)
    for t in np.flatnonzero((lengths != lengths[:, :1]).any(axis=1)):
        raise InputError(path, f"the taxels of trial {t} have different lengths {lengths[t].tolist()}; expected one")
    trials = []
    for i in range(n_trials):
        rows = slice(starts[i * n_taxels], starts[(i + 1) * n_taxels])
        d, v = (data[name][rows].reshape(n_taxels, -1, 3).swapaxes(0, 1) for name in _ARRAYS[:2])
        stamps = _SAMPLE_PERIOD_S * np.arange(len(d))
        trials.append(Trial(stamps, _finite(d), _finite(v), outcome[i] > 0))
    return tuple(trials)


def _finite(array: NDArray[np.generic]) -> Array:
    numbers = array.astype(np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _check(path: Path, data: dict[str, NDArray[np.generic]]) -> None:
    """InputError where an array has not the shape and kind it must have."""
    for name, array in data.items():
        if array.dtype.kind not in "iufb":
            raise InputError(path, f"{name} holds {array.dtype}; expected numbers")
    outcome, offsets = data["outcome"], data["offsets"]
    if outcome.ndim != 2 or 0 in outcome.shape:
        raise InputError(path, f"outcome of shape {outcome.shape}; expected (trials, taxels), at least one of each")
    strange = ~np.isin(outcome, (-1, 0, 1))
    if strange.any():
        raise InputError(path, f"{outcome[strange][0]} in outcome; expected 1 (touched) or -1 (not)")
    if offsets.shape != (outcome.size + 1,) or offsets.dtype.kind not in "iu":
        found = f"{offsets.dtype} offsets of shape {offsets.shape}"
        raise InputError(path, f"{found}; expected {outcome.size + 1} whole numbers for {outcome.size} pairs")
    if offsets[0] != 0 or np.any(np.diff(offsets.astype(np.int64)) < 1):
        raise InputError(path, "offsets that do not rise from 0; expected where each pair's samples start")
    for name in _ARRAYS[:2]:
        if data[name].shape != (offsets[-1], 3):
            raise InputError(path, f"{name} of shape {data[name].shape}; expected ({offsets[-1]}, 3), by offsets")
