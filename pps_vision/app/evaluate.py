"""Score a path against the true one: `pps-vision evaluate`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from pps_vision.errors import InputError
from pps_vision.recordings.tables import COVARIANCE, attended_rows, column_names, covariances, numbers, read_table
from pps_vision.recordings.text import read_lines
from pps_vision.types import Array, Mask, Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BRIDGED = 1.5  # times the median interval: a longer one is a gap, across which nothing is interpolated
_LAG_S = 0.5  # search range
_LAG_STEP_S = 0.005
_FEWEST = 3  # positions to compare


@dataclass(frozen=True)
class Path3D:
    """Known positions in order of time."""

    name: str  # where it is from
    stamps_s: Array  # (n,) increasing
    position: Array  # (n, 3) m
    cov: Array  # (n, 3, 3) m², NaN where none is stated
    unknown: int = 0  # how many rows or frames without a position were left out
    missing: tuple[int, ...] = ()  # lines of rows without a position whose status does not say so


@dataclass(frozen=True)
class Score:
    """How far a path is from the true one; errors are track minus truth, at the track's stamps."""

    name: str
    compared: int  # positions with a truth at their stamp
    rmse_mm: float
    median_mm: float
    p95_mm: float
    bias_x_mm: float
    bias_y_mm: float
    bias_z_mm: float
    lost_share: float  # share of the truth's stamps at which the track has no position
    coverage_95: float  # share of the truth that the stated 95 % ellipsoids hold; NaN without covariances
    nees: float  # mean normalised squared error; 3 for true covariances
    lag_s: float  # seconds by which the track's stamps are late; 0 unless it was estimated
    rows: int  # rows of the track
    unknown: int  # rows of the track without a position: searching, lost, or empty


def read_path(file: Path, fps: float | None = None, track_id: int | None = None) -> Path3D:
    """Read trajectory.csv, truth.csv, another CSV with stamp_s, x_m, y_m and z_m, TUM's form, or Anipose's table of one
    point (in m), whose frames come at `fps` from 0 s on.

    Of several tracks the attended one is read, or the one with the number `track_id`.  Rows without a position are left
    out.  InputError for one that cannot be read or has no stamp, or stamps that do not increase.
    """
    header = column_names(file)
    anipose = [name.removesuffix("_x") for name in header if name.endswith("_x")] if "fnum" in header else []
    searching: set[int] = set()
    if "stamp_s" in header:
        names = ["stamp_s", "x_m", "y_m", "z_m", *(COVARIANCE if set(COVARIANCE) <= set(header) else ())]
        rows = read_table(file, names)
        if "track_id" in header:
            rows = attended_rows(rows) if track_id is None else _rows_of_track(file, rows, track_id)
        if "status" in header:
            status = read_table(file, ["status"])
            searching = {line for line, (value,) in status if value in (Status.SEARCHING, Status.LOST)}
    elif anipose:
        if len(anipose) > 1:
            raise InputError(file, f"has the points {', '.join(anipose)}; expected one point", 1)
        if fps is None:
            raise InputError(file, "has numbers of frames, no stamps; expected --fps, the frames per second", 1)
        if not 0 < fps < np.inf:
            raise InputError("evaluate", f"--fps {fps}; expected a positive number of frames per second")
        rows = read_table(file, ["fnum", *(f"{anipose[0]}_{axis}" for axis in "xyz")])
    else:
        expected = "rows of stamp x y z (TUM), or a CSV with the columns stamp_s, x_m, y_m, z_m"
        lines = enumerate(read_lines(file, expected), start=1)
        rows = [(line, row.split()[:4]) for line, row in lines if row.strip() and not row.lstrip().startswith("#")]
        if short := [line for line, row in rows if len(row) < 4]:
            raise InputError(file, f"fewer than four numbers; expected {expected}", short[0])
    values = [(line, numbers(file, line, row)) for line, row in rows]
    if anipose and fps:
        values = [(line, [row[0] / fps, *row[1:]]) for line, row in values]
    if unstamped := [line for line, row in values if not np.isfinite(row[0])]:
        raise InputError(file, "has no stamp; expected one in every row", unstamped[0])
    positions = [(line, row) for line, row in values if np.all(np.isfinite(row[1:4]))]
    missing = {line for line, _ in values} - {line for line, _ in positions} - searching
    for (_, (last_s, *_)), (line, (stamp_s, *_)) in pairwise(positions):
        if not stamp_s > last_s:
            raise InputError(file, f"stamp {stamp_s} after {last_s}; expected stamps that increase", line)
    table = np.array([row for _, row in positions] or np.zeros((0, 4)))
    cov = covariances(table[:, 4:]) if table.shape[1] == 10 else np.full((len(table), 3, 3), np.nan)
    return Path3D(str(file), table[:, 0], table[:, 1:4], cov, len(values) - len(positions), tuple(sorted(missing)))


def _rows_of_track(file: Path, rows: list[tuple[int, list[str]]], track_id: int) -> list[tuple[int, list[str]]]:
    ids = {line: field for line, (field,) in read_table(file, ["track_id"])}
    chosen = [(line, row) for line, row in rows if ids[line] == str(track_id)]
    if not chosen:
        known = ", ".join(sorted(set(ids.values()), key=lambda field: (len(field), field)))
        raise InputError(file, f"no row of track {track_id}; expected one of {known}")
    return chosen


def evaluate(track: Path3D, truth: Path3D, lag: bool = False, align: bool = False) -> Score:
    """Score a path; InputError if fewer than three of its positions have a truth.

    The truth is interpolated between its rows to the track's stamps, but not across its gaps. `lag`: estimate by how
    much the track's stamps are late (within 0.5 s), and correct it; `align`: rotate and shift the track onto the truth
    (least squares, without scale) first.
    """
    lag_s = _lag_s(track, truth, align) if lag else 0.0
    moved = replace(track, stamps_s=track.stamps_s - lag_s)
    _, error, cov = errors_of(moved, truth, align)
    if len(error) < _FEWEST:
        problem = f"{len(error)} of {len(track.stamps_s)} positions have a truth at their stamp in {truth.name}"
        if len(moved.stamps_s) and len(truth.stamps_s):
            problem += f" (stamps {_span(moved)}; of the truth {_span(truth)})"
        raise InputError(track.name, f"{problem}; expected at least {_FEWEST}")
    distance_mm = 1000 * np.linalg.norm(error, axis=1)
    stated = np.all(np.isfinite(cov), axis=(1, 2))
    stated[stated] = np.all(np.linalg.eigvalsh(cov[stated]) > 0, axis=1)
    nees = np.einsum("ni,ni->n", error[stated], np.linalg.solve(cov[stated], error[stated][..., None])[..., 0])
    bias = 1000 * error.mean(axis=0)
    return Score(
        track.name,
        len(error),
        float(np.sqrt(np.mean(distance_mm**2))),
        float(np.median(distance_mm)),
        float(np.percentile(distance_mm, 95)),
        bias_x_mm=float(bias[0]),
        bias_y_mm=float(bias[1]),
        bias_z_mm=float(bias[2]),
        lost_share=1 - float(np.mean(_covered(moved, truth.stamps_s))),
        coverage_95=float(np.mean(nees <= chdtri(3, 0.05))) if len(nees) else np.nan,
        nees=float(np.mean(nees)) if len(nees) else np.nan,
        lag_s=lag_s,
        rows=len(track.stamps_s) + track.unknown,
        unknown=track.unknown,
    )


def _span(path: Path3D) -> str:
    return f"{path.stamps_s[0]:.3f} to {path.stamps_s[-1]:.3f} s"


def rigid_alignment(points: Array, onto: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) with the least squared distances |R points + t − onto|² (Umeyama 1991)."""
    U, _, Vt = np.linalg.svd((onto - onto.mean(axis=0)).T @ (points - points.mean(axis=0)))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return R, onto.mean(axis=0) - R @ points.mean(axis=0)


def errors_of(track: Path3D, truth: Path3D, align: bool = False) -> tuple[Array, Array, Array]:
    """The track's stamps (m,) at which there is a truth, track minus truth (m, 3) in m, and the stated covariances
    (m, 3, 3)."""
    at = _covered(truth, track.stamps_s)
    stamps = track.stamps_s[at]
    position = track.position[at]
    cov = track.cov[at]
    true = position
    if at.any():
        true = np.stack([np.interp(stamps, truth.stamps_s, column) for column in truth.position.T], axis=1)
    if align and len(position) >= _FEWEST:
        R, t = rigid_alignment(position, true)
        position = position @ R.T + t
        cov = R @ cov @ R.T
    return stamps, position - true, cov


def _covered(path: Path3D, stamps_s: Array) -> Mask:
    """(m,) whether a path has a position at each stamp: one there, or on both sides with no gap between."""
    own = path.stamps_s
    if not len(own):
        return np.zeros(len(stamps_s), dtype=bool)
    longest_s = _BRIDGED * float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    tolerance_s = 1e-3 * longest_s + 1e-6  # of stamps in doubles that count seconds since 1970
    next_s = own[np.clip(np.searchsorted(own, stamps_s, "left"), 0, len(own) - 1)]
    last_s = own[np.clip(np.searchsorted(own, stamps_s, "right") - 1, 0, len(own) - 1)]
    nearest_s = np.minimum(np.abs(next_s - stamps_s), np.abs(stamps_s - last_s))
    between = (last_s <= stamps_s) & (stamps_s <= next_s) & (next_s - last_s <= longest_s)
    return between | (nearest_s <= tolerance_s)


def _lag_s(track: Path3D, truth: Path3D, align: bool) -> float:
    """The lag of the track's stamps that minimises the mean squared error and leaves most positions with a truth."""

    def cost(lag_s: float) -> float:
        _, error, _ = errors_of(replace(track, stamps_s=track.stamps_s - lag_s), truth, align)
        return float(np.mean(np.sum(error**2, axis=1))) if len(error) >= 0.5 * len(track.stamps_s) else np.inf

    lags = np.arange(-_LAG_S, _LAG_S + _LAG_STEP_S / 2, _LAG_STEP_S)
    best = float(lags[int(np.argmin([cost(lag_s) for lag_s in lags]))])
    bounds = (best - _LAG_STEP_S, best + _LAG_STEP_S)
    optimum = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-6})
    return float(optimum.x) if np.isfinite(optimum.fun) else best


def path_errors(paths: Sequence[Path3D], truth: Path3D, scores: Sequence[Score], align: bool) -> "Figure":
    """Distance to the truth over time, and the share of positions within a distance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4), layout="constrained")
    over_time, share = figure.subplots(1, 2, width_ratios=(2, 1))
    for path, score in zip(paths, scores, strict=True):
        stamps, error, _ = errors_of(replace(path, stamps_s=path.stamps_s - score.lag_s), truth, align)
        distance_mm = 1000 * np.linalg.norm(error, axis=1)
        name = f"{path.name}: RMSE {score.rmse_mm:.2f} mm"
        over_time.plot(stamps - truth.stamps_s[0], distance_mm, ".-", ms=3, lw=0.8, label=name)
        share.plot(np.sort(distance_mm), np.arange(1, len(distance_mm) + 1) / len(distance_mm))
    over_time.set(xlabel="time (s)", ylabel="3D error (mm)", ylim=(0, None))
    share.set(xlabel="3D error (mm)", ylabel="share of positions", ylim=(0, 1), xlim=(0, None))
    over_time.legend(fontsize=7)
    for axis in (over_time, share):
        axis.grid(alpha=0.25)
    return figure
