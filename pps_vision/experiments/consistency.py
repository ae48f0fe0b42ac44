"""Whether the tracker's covariances are those of its errors: NEES, NIS, coverage of intervals, time to contact."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm
from tqdm import tqdm

from learning.pps.receptive_field import ReceptiveField, distance_and_ttc, distance_and_ttc_variance
from pps_vision.experiments.charts import PAGE_IN, calibration, panels
from pps_vision.experiments.constants import FILMED
from pps_vision.experiments.independent_cases import CASES, Case
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.scenarios import KINDS, MOTIONS, SPEEDS, Footage, from_film, of_kind
from pps_vision.experiments.score import steps_of
from pps_vision.experiments.study import (
    DATA,
    Metric,
    SceneSource,
    TrackingStudy,
    Values,
    mean,
    measure,
    median,
    percent,
    summarize,
)
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.types import Array, Status, Track3D
from tracking import kalman
from tracking.kalman import KalmanParams
from tracking.tracker import Tracker, TrackerStep

QUANTITIES = ("position", "velocity", "distance", "time to contact")
SETTLED = 10
"""Frames before a tracker is judged."""
FITTED_ON: Mapping[SceneSource, tuple[int, ...]] = {"rendered": (300,), "independent": (7000, 7001)}
"""Seeds of the scenes on which the covariance's constants were fitted (`tracking.stereo`, `tracking.kalman`): as many
others were held out."""
_COVERAGES = tuple(f"{quantity} {share}" for quantity in ("position", "velocity") for share in (68, 95))
_SIGMAS = {68: float(norm.ppf(0.84)), 95: float(norm.ppf(0.975))}
GOALS = {68: 5.0, 95: 3.0}
"""By stated share: how far, in points, the share found may be from it."""
_LATE_S = (0.02, 0.5)  # before the touch: where an error of the time to contact counts
_FIELD = ReceptiveField(np.pi / 2 - 1e-9, length_m=10.0, distance_to="surface", min_closing_sigmas=0.0)  # all of space
_ASIDE_M = np.array([0.0, 0.0, -0.15])  # from the path's middle: a point whose distance is asked for
_METRICS = {
    **{f"{q} {s}": Metric(f"{q} {s}", percent) for q in QUANTITIES for s in _SIGMAS},
    "nees": Metric("nees", mean),
    "nis": Metric("nis", mean),
    "ttc_percent": Metric("ttc_percent", median),
}


@dataclass(frozen=True)
class Consistency(TrackingStudy):
    """Balls and markers while the head moves: the tracks' errors against their own covariances, by 95 % intervals from
    resampling recordings.

    Judged from the tenth frame on while the status is tracking, without the two frames after a jump of the velocity.
    Coverage on the scenes that the covariance's constants were fitted on stands beside that on held-out ones of the
    same kind: rendered recordings, and films of the tracking table.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"cases": ("vivid, red",)}

    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    cases: tuple[str, ...] = FILMED
    """Cases of `bench independent` that are filmed."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""

    def run(self) -> dict[str, Any]:
        """Return by source and group of recordings: coverage in percent, mean NEES (6 expected) and NIS (3), error of
        the time to contact in the last half second."""
        found: dict[str, Any] = {}
        for source in self.sources:
            kinds = {k: partial(of_kind, k, source, self.seconds) for k in sorted(KINDS, key=lambda k: k.split(",")[0])}
            measured = measure(kinds, {"tracker": _run}, self.seeds)
            pooled: dict[str, list[Values]] = {group: [] for group in ("all", "ball", "marker", *MOTIONS, *SPEEDS)}
            for kind, of in measured.items():
                for group in ("all", *kind.split(", ")):
                    pooled[group] += of["tracker"]
            found[source] = summarize(pooled, _METRICS)
        return {"cells": found, "halves": {source: self._halves(source) for source in self.sources}}

    def _halves(self, source: SceneSource) -> dict[str, Any]:
        """Coverage on the scenes that the constants were fitted on, and on as many others."""
        fitted = FITTED_ON[source]
        seeds = {"fitted": fitted, "held out": range(self.seed, self.seed + len(fitted))}
        of = self._of_recordings if source == "rendered" else self._of_films
        return summarize(
            {half: of(some) for half, some in seeds.items()}, {name: _METRICS[name] for name in _COVERAGES}
        )

    def _of_recordings(self, seeds: Sequence[int]) -> list[Values]:
        kinds = {kind: partial(of_kind, kind, "rendered", self.seconds) for kind in KINDS}
        return [one for of in measure(kinds, {"tracker": _run}, seeds).values() for one in of["tracker"]]

    def _of_films(self, seeds: Sequence[int]) -> list[Values]:
        cases = [case for case in CASES if case.name in self.cases]
        made = [(case, Film(case.scene(k), seed, self.data)) for k, seed in enumerate(seeds) for case in cases]
        return [_of_film(case, film) for case, film in tqdm(made, desc="films", disable=None)]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Found against stated coverage, one panel a source; what the goals allow is shaded."""
        cells = numbers["cells"]
        figure, axes = panels(len(cells), width=PAGE_IN / len(cells), height=3.4)
        for axis, (source, groups) in zip(axes, cells.items(), strict=True):
            found = {q: [groups["all"][f"{q} {s}"] for s in _SIGMAS] for q in QUANTITIES}
            for share, allowed in GOALS.items():
                axis.fill_between([share - 2, share + 2], share - allowed, share + allowed, color="0.85", lw=0)
            calibration(axis, list(_SIGMAS), found, "truth inside the interval (%)")
            axis.set(xlim=(60, 100), ylim=(60, 100))
            axis.set_title(f"{source} scenes", fontsize=10)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return coverage, bold where its goal is missed, NEES, NIS and error of the time to contact by source, with
        intervals over recordings."""
        rows = []
        for source, groups in numbers["cells"].items():
            cell = groups["all"]
            for q in QUANTITIES:
                found = {share: cell[f"{q} {share}"] for share in _SIGMAS}
                rows.append([f"{source}: {q}", *(covered(share, of) for share, of in found.items())])
        header = ["truth inside the interval (%)", "68 % intervals", "95 % intervals"]
        more = [
            [f"{source}: {group}", *(estimate(cell[m]) for m in ("nees", "nis", "ttc_percent"))]
            for source, groups in numbers["cells"].items()
            for group, cell in groups.items()
        ]
        halves = [
            [f"{source}, {half}", *(estimate(cell[name]) for name in _COVERAGES)]
            for source, of in numbers["halves"].items()
            for half, cell in of.items()
        ]
        return {
            "": Table(header, rows),
            "nees": Table(["scenes", "mean NEES (6)", "mean NIS (3)", "time to contact (%)"], more),
            "halves": Table(["scenes", *_COVERAGES], halves),
        }


def covered(share: int, found: Sequence[float]) -> str:
    """Return the coverage [value, low, high] of intervals of a stated `share`, in bold where its goal is missed."""
    return judged(estimate(found), misses(share, found[0]))


def misses(share: int, found: float) -> bool:
    """Whether a coverage, to a tenth of a percent, is farther from the stated share than the goal allows."""
    return abs(round(found, 1) - share) > GOALS[share]


def _of_film(case: Case, film: Film) -> Values:
    """`values_of` a film of the tracking table."""
    recording = from_film(film)
    tracker = Tracker(case.tracker(film.hue_deg), film.rig, np.random.default_rng(film.seed))
    return values_of(recording, [tracker.step(frame) for frame in recording.frames])


def _run(recording: Footage, seed: int) -> Values:
    return values_of(recording, steps_of(recording, seed)[0])


def values_of(recording: Footage, steps: Sequence[TrackerStep]) -> dict[str, list[float]]:
    """Return one recording's values: hits of the intervals frame by frame, mean NEES and NIS, errors of the time to
    contact."""
    found: dict[str, list[float]] = {metric.values: [] for metric in _METRICS.values()}
    point = recording.position.mean(axis=0) + _ASIDE_M
    touched, ttc = recording.touch()
    usual = ~recording.jumped & (np.arange(len(steps)) >= SETTLED)
    nees = []
    for k, step in enumerate(steps):
        if not usual[k] or step.track.status != Status.TRACKING:
            continue
        track, true = step.track, np.concatenate([recording.position[k], recording.velocity[k]])
        error = track.mean[:2].ravel() - true
        nees.append(float(error @ np.linalg.solve(track.cov[:6, :6], error)))
        z = np.abs(error) / np.sqrt(np.diag(track.cov)[:6])
        distance_m, _, distance_std_m, _ = contact(track, point)
        true_m = float(np.linalg.norm(recording.position[k] - point)) - recording.radius_m
        off = {
            "position": z[:3],
            "velocity": z[3:],
            "distance": [abs(distance_m - true_m) / distance_std_m],
        }
        for share, sigmas in _SIGMAS.items():
            for quantity, ratios in off.items():
                found[f"{quantity} {share}"].extend(float(ratio < sigmas) for ratio in ratios)
        if not ttc[k] > _LATE_S[0]:
            continue
        _, ttc_s, _, ttc_std_s = contact(track, touched)
        for share, sigmas in _SIGMAS.items():
            found[f"time to contact {share}"].append(float(abs(ttc_s - ttc[k]) <= sigmas * ttc_std_s))
        error_percent = 100 * abs(ttc_s / ttc[k] - 1)
        if ttc[k] <= _LATE_S[1]:
            found["ttc_percent"].append(error_percent)
    found["nees"] = [float(np.mean(nees))] if nees else []
    found["nis"] = nis_of(steps, usual)
    return found


def contact(track: Track3D, point: Array) -> tuple[float, float, float, float]:
    """Return the distance (m) from the track's surface to a point (3,), the time to contact (s), and their standard
    deviations."""
    d = (track.position - point)[None]
    normal = d / np.linalg.norm(d)
    means = distance_and_ttc(_FIELD, d, normal, track.velocity, track.radius_m)
    variances = distance_and_ttc_variance(
        _FIELD, d, normal, track.velocity, track.cov[:6, :6], track.radius_m, track.radius_var_m2
    )
    D, ttc, D_var, ttc_var = (float(values[0]) for values in (*means, *variances))
    return D, ttc, D_var**0.5, ttc_var**0.5


def nis_of(steps: Sequence[TrackerStep], usual: Any) -> list[float]:
    """Return the mean squared Mahalanobis distance of the innovations in the usual frames: the tracker's own filter,
    run again on what it measured; nothing where it measured nothing."""
    belief, params, found = None, KalmanParams(), []
    for step, counts in zip(steps, usual, strict=True):
        seen = step.observation
        if seen is None:
            continue
        if belief is None:
            params = kalman.scaled(params, float(np.linalg.norm(seen.p_root - step.midpoint_root)))
            measured = params, seen.stamp_s, seen.p_root, seen.cov_root
            belief = kalman.start(*measured, correlated=seen.correlated_cov_root)
            continue
        belief = kalman.predict(params, belief, seen.stamp_s)
        belief = kalman.update(params, belief, seen.p_root, seen.cov_root, seen.correlated_cov_root)
        if counts:
            found.append(belief.nis)
    return [float(np.mean(found))] if found else []
