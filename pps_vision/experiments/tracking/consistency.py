"""Consistency of the tracker's covariance: coverage of its intervals."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import approx_fprime
from scipy.stats import norm

from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.experiments.films.recordings import KINDS, Footage, of_kind
from pps_vision.experiments.films.score import steps_of
from pps_vision.experiments.study import Metric, measure, percent, summarize
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.types import Array, Status, Track3D

QUANTITIES = ("position", "velocity", "distance", "time to contact")
GOALS = {68: 5.0, 95: 3.0}  # largest difference between stated and measured coverage (points), by stated coverage (%)
_SETTLED = 10  # frames before a tracker is judged
_SIGMAS = {68: float(norm.ppf(0.84)), 95: float(norm.ppf(0.975))}
_LATEST_S = 0.02  # before the touch, until when the time to contact counts
_FIELD = ReceptiveField(np.pi / 2 - 1e-9, length_m=10.0, distance_to="surface", min_closing_sigmas=0.0)  # all of space
_POINT_FROM_PATH_M = np.array([0.0, 0.0, -0.15])  # from the path's middle: the point whose distance is predicted
_METRICS = {f"{q} {s}": Metric(f"{q} {s}", percent) for q in QUANTITIES for s in _SIGMAS}


def run(study: Any) -> dict[str, Any]:
    """Judge tracks of balls and markers by their own covariances, while the head moves.

    Judged from the tenth frame on while the status is tracking, without the two frames after a jump of the velocity.
    Returns the coverage in percent by source.
    """
    cells = {}
    seeds = range(study.seed, study.seed + study.n_consistency)
    by_object = sorted(KINDS, key=lambda kind: kind.split(",")[0])
    for source in study.sources:
        kinds = {kind: partial(of_kind, kind, source, study.seconds) for kind in by_object}
        methods = {"tracker": lambda r, seed: judge_covariances(r, [step.track for step in steps_of(r, seed)[0]])}
        measured = measure(kinds, methods, seeds)
        recordings = [values for methods in measured.values() for values in methods["tracker"]]
        cells[source] = summarize({"all": recordings}, _METRICS)
    return {"cells": cells}


def table(numbers: dict[str, Any]) -> Table:
    """Return the coverage by source, bold where its goal is missed, with intervals over recordings."""
    rows = []
    for source, groups in numbers["cells"].items():
        for q in QUANTITIES:
            coverage = {share: groups["all"][f"{q} {share}"] for share in _SIGMAS}
            cells = [judged(estimate(values), misses(share, values[0])) for share, values in coverage.items()]
            rows.append([f"{source}: {q}", *cells])
    return Table(["truth inside the interval (%)", "68 % intervals", "95 % intervals"], rows)


def misses(share: int, coverage: float) -> bool:
    """Whether a coverage, to a tenth of a percent, is farther from the stated share than the goal allows."""
    return abs(round(coverage, 1) - share) > GOALS[share]


def judge_covariances(recording: Footage, tracks: Sequence[Track3D]) -> dict[str, list[float]]:
    """Return the values of one recording: whether each interval holds the truth."""
    values: dict[str, list[float]] = {metric.values: [] for metric in _METRICS.values()}
    point = recording.position.mean(axis=0) + _POINT_FROM_PATH_M
    touched, ttc = recording.touch()
    judged_frames = ~recording.jumped & (np.arange(len(tracks)) >= _SETTLED)
    for k, track in enumerate(tracks):
        if not judged_frames[k] or track.status != Status.TRACKING:
            continue
        truth = np.concatenate([recording.position[k], recording.velocity[k]])
        error = track.mean[:2].ravel() - truth
        z = np.abs(error) / np.sqrt(np.diag(track.cov)[:6])
        distance_m, _, distance_std_m, _ = contact(track, point)
        true_distance_m = float(np.linalg.norm(recording.position[k] - point)) - recording.radius_m
        z_scores = {
            "position": z[:3],
            "velocity": z[3:],
            "distance": [abs(distance_m - true_distance_m) / distance_std_m],
        }
        if ttc[k] > _LATEST_S:
            _, ttc_s, _, ttc_std_s = contact(track, touched)
            z_scores["time to contact"] = [abs(ttc_s - ttc[k]) / ttc_std_s]
        for share, sigmas in _SIGMAS.items():
            for quantity, scores in z_scores.items():
                values[f"{quantity} {share}"].extend(float(score < sigmas) for score in scores)
    return values


def contact(track: Track3D, point: Array) -> tuple[float, float, float, float]:
    """Return the distance (m) from the track's surface to a point (3,), the time to contact (s), and their standard
    deviations."""

    def contact_of(x: Array) -> Array:
        normal = (x[:3] - point) / np.linalg.norm(x[:3] - point)
        return np.ravel(perceive(_FIELD, point[None], normal, x[:3], x[3:6], float(x[6])))

    estimate = np.append(track.mean[:2].ravel(), track.radius_m)
    J = approx_fprime(estimate, contact_of, 1e-7)
    variances = np.einsum("ij,jk,ik->i", J, block_diag(track.cov[:6, :6], track.radius_var_m2), J)
    means = contact_of(estimate)
    return float(means[0]), float(means[1]), float(variances[0] ** 0.5), float(variances[1] ** 0.5)
