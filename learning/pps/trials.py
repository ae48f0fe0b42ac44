"""Recorded trials: an object approaches the taxels of a real robot, and some are touched at the end.

The layout is that of the authors' released data.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learning.archive import UNREADABLE
from pps_vision.errors import InputError
from pps_vision.types import Array, Mask

SAMPLE_PERIOD_S = 0.1  # of the released, resampled positions and velocities
_ARRAYS = ("position_m", "velocity_m_s", "offsets", "outcome")


@dataclass(frozen=True)
class Trial:
    """One approach: displacements from the taxels `d_m` and velocities `v_m_s` (T, n, 3) in the taxels'
    frames (z is the normal), NaN where unknown, and which taxels were touched at its end (n,)."""

    stamps_s: Array
    d_m: Array
    v_m_s: Array
    touched: Mask


def touch_rates(trials: tuple[Trial, ...]) -> Array:
    """(n,) share of the trials in which each taxel was touched."""
    rates: Array = np.mean([trial.touched for trial in trials], axis=0)
    return rates


def load_trials(path: Path) -> tuple[Trial, ...]:
    """Read a trials file; ValueError names the file and what is wrong with it.

    Infinite samples are read as NaN, unknown.
    """
    data = _arrays(path)
    outcome, starts = data["outcome"], data["offsets"]
    n_trials, n_taxels = outcome.shape
    lengths = np.diff(starts).reshape(n_trials, n_taxels)
    for t in np.flatnonzero((lengths != lengths[:, :1]).any(axis=1)):
        raise InputError(path, f"the taxels of trial {t} have different lengths {lengths[t].tolist()}; expected one")
    trials = []
    for i in range(n_trials):
        rows = slice(starts[i * n_taxels], starts[(i + 1) * n_taxels])
        d, v = (data[name][rows].reshape(n_taxels, -1, 3).swapaxes(0, 1) for name in _ARRAYS[:2])
        stamps = SAMPLE_PERIOD_S * np.arange(len(d))
        trials.append(Trial(stamps, _known(d), _known(v), outcome[i] > 0))
    return tuple(trials)


def _known(array: NDArray[np.generic]) -> Array:
    numbers = array.astype(np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _arrays(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of a trials file, each of the shape and kind it must have."""
    try:
        with np.load(path) as file:
            missing = [name for name in _ARRAYS if name not in file]
            data = {name: np.asarray(file[name]) for name in _ARRAYS if name in file}
    except FileNotFoundError:
        raise InputError(path, "no such file; expected trials (.npz)") from None
    except UNREADABLE as error:
        raise InputError(path, f"is not a readable .npz file; expected one with {', '.join(_ARRAYS)}") from error
    if missing:
        raise InputError(path, f"no {', '.join(missing)}; expected an .npz file with {', '.join(_ARRAYS)}")
    for name, array in data.items():
        if array.dtype.kind not in "iufb":
            raise InputError(path, f"{name} holds {array.dtype}; expected numbers")
    outcome, offsets = data["outcome"], data["offsets"]
    if outcome.ndim != 2 or 0 in outcome.shape:
        raise InputError(path, f"outcome of shape {outcome.shape}; expected (trials, taxels), at least one of each")
    strange = ~np.isin(outcome, (-1, 0, 1))
    if strange.any():
        raise InputError(path, f"{outcome[strange][0]} in outcome; expected 1 (touched) or -1 (not)")
    _check_offsets(path, offsets, outcome.size)
    for name in _ARRAYS[:2]:
        if data[name].shape != (offsets[-1], 3):
            raise InputError(path, f"{name} of shape {data[name].shape}; expected ({offsets[-1]}, 3), by offsets")
    return data


def _check_offsets(path: Path, offsets: NDArray[np.generic], pairs: int) -> None:
    if offsets.shape != (pairs + 1,) or offsets.dtype.kind not in "iu":
        raise InputError(
            path,
            f"{offsets.dtype} offsets of shape {offsets.shape}; "
            f"expected {pairs + 1} whole numbers for {pairs} pairs of trial and taxel",
        )
    if offsets[0] != 0 or np.any(np.diff(offsets.astype(np.int64)) < 1):
        raise InputError(path, "offsets that do not rise from 0; expected where each pair's samples start")
