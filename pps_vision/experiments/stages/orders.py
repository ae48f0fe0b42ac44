"""Order 1 to 4 of the Kalman filter by kind of motion and frame rate, on the same measurements: errors against order 3.

Motions at 15–60 cm/s about 0.4 m from the eyes, measured with white noise as of a stereo pair; table-tennis flights
(tt3d) thinned to each rate; and our tracker's measurements of rendered balls at 5–15 cm/s while the head moves. Order 4
is shown with its default decay of the jerk, a slower one and, as in R, none.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.charts import PAGE_IN, panels
from pps_vision.experiments.films.recordings import moving
from pps_vision.experiments.stages.filter import Measurements, flights, measurements
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array
from rendering.motions import make_motion
from rendering.names import MotionName
from tracking import kalman
from tracking.kalman import KalmanParams

RATES_HZ = (20.0, 60.0, 240.0)
_TABLE_HZ = 60.0
_MOTIONS: tuple[MotionName, ...] = ("linear", "circle", "figure8", "jerk")
KINDS = (*_MOTIONS, "swing")
_ORDERS: dict[str, KalmanParams] = {
    **{f"order {order}": KalmanParams.of_order(order) for order in (1, 2, 3, 4)},
    "order 4, jerk 0.1 s": replace(KalmanParams.of_order(4), decay_s=(0.4, 0.1)),
    "order 4, undamped": replace(KalmanParams.of_order(4), decay_s=(np.inf, np.inf)),
}
_REFERENCE = "order 3"
_METRICS = {"velocity": "velocity error", "position": "position error"}
_NOISE_M = np.array([0.15e-3, 0.15e-3, 1.2e-3])  # across the line of sight, and along it: 0.1 px at 0.4 m, iCub's eyes
_CENTER_M = np.array([0.0, 0.0, 0.4])
_SPEEDS_M_S = (0.15, 0.6)
_SWING_HZ = (0.5, 2.0)
_SETTLE_S = 0.5
_SECONDS = 4.0
_TRACKED_S = 1.5
_TICKS = (0.6, 0.8, 1.0, 1.4, 2.0)  # ticks of the chart
_DERIVATIVE_S = 0.03  # over which the velocity of a flight is taken from its true path


def run(study: Any) -> dict[str, Any]:
    """Return by motion, rate and order each error as a ratio to that of order 3, paired by recording."""
    makers: dict[str, list[Callable[[float], tuple[Measurements, Array]]]] = {
        kind: [partial(_moving, kind, seed) for seed in range(study.seed, study.seed + 2 * study.n)] for kind in KINDS
    }
    makers["tracked ball"] = [
        partial(_tracked, motion, seed)
        for motion in _MOTIONS
        for seed in range(study.seed, study.seed + -(-study.n // 4))
    ]
    folder = study.data / "tt3d"
    if folder.exists():
        makers["flight (tt3d)"] = [partial(_flight, flight) for flight in flights(folder)]
    cells = {
        f"{kind}, {rate_hz:g} Hz": _ratios([make(rate_hz) for make in recordings])
        for kind, recordings in makers.items()
        for rate_hz in RATES_HZ
    }
    return {"cells": cells} | ({} if folder.exists() else {"not_measured": f"tt3d: no {folder}"})


def _moving(kind: str, seed: int, rate_hz: float) -> tuple[Measurements, Array]:
    """Measurements of a motion and its true velocity (n, 3)."""
    rng = np.random.default_rng(seed)
    stamps_s = np.arange(round(_SECONDS * rate_hz)) / rate_hz
    speed = float(np.exp(rng.uniform(*np.log(_SPEEDS_M_S))))
    if kind == "swing":  # there and back on a line, as an arm swings
        direction = rng.standard_normal(3)
        angle = 2 * np.pi * np.exp(rng.uniform(*np.log(_SWING_HZ)))
        way = speed / angle * direction / np.linalg.norm(direction)
        path = _CENTER_M + np.sin(angle * stamps_s)[:, None] * way
        velocity = angle * np.cos(angle * stamps_s)[:, None] * way
    else:
        motion = make_motion(kind, rng, _CENTER_M, speed)  # type: ignore[arg-type]
        path, velocity = (np.array(rows) for rows in zip(*map(motion, stamps_s), strict=True))
    noise = _NOISE_M * np.random.default_rng((seed, round(rate_hz))).standard_normal(path.shape)
    covs = np.broadcast_to(np.diag(_NOISE_M**2), (len(path), 3, 3))
    counts = stamps_s >= _SETTLE_S
    return Measurements(stamps_s, path + noise, covs, path, float(_CENTER_M[2]), counts), velocity


def _tracked(motion: MotionName, seed: int, rate_hz: float) -> tuple[Measurements, Array]:
    """Our tracker's measurements of a rendered ball."""
    recording = moving("ball", motion, seed, _TRACKED_S, fps=rate_hz)
    data = measurements(recording, seed)
    rows = np.abs(recording.stamps_s - data.stamps_s[:, None]).argmin(axis=1)
    return data, recording.velocity[rows]


def _flight(flight: Measurements, rate_hz: float) -> tuple[Measurements, Array]:
    """A flight thinned to a rate, and its velocity from the true path: a parabola through the points around each."""
    velocity = np.empty_like(flight.path)
    for k, stamp_s in enumerate(flight.stamps_s):
        away_s = np.abs(flight.stamps_s - stamp_s)
        near = np.argsort(away_s)[: max(5, np.count_nonzero(away_s < _DERIVATIVE_S))]
        velocity[k] = np.polyfit(flight.stamps_s[near] - stamp_s, flight.path[near], 2)[1]
    kept = [0]
    for k, stamp_s in enumerate(flight.stamps_s):
        if stamp_s - flight.stamps_s[kept[-1]] >= 0.99 / rate_hz:
            kept.append(k)
    thinned = replace(
        flight,
        stamps_s=flight.stamps_s[kept],
        positions=flight.positions[kept],
        covs=flight.covs[kept],
        path=flight.path[kept],
        counts=flight.stamps_s[kept] >= flight.stamps_s[0] + 0.2,
    )
    return thinned, velocity[kept]


def _ratios(recordings: list[tuple[Measurements, Array]]) -> dict[str, dict[str, Any]]:
    """By order and error: RMS (mm, mm/s), and the mean ratio to order 3 with its 95 % interval over recordings."""
    errors: dict[str, dict[str, list[float]]] = {name: {metric: [] for metric in _METRICS} for name in _ORDERS}
    for data, velocity in recordings:
        for name, params in _ORDERS.items():
            states = data.filtered(kalman.scaled(params, data.distance_m))
            places = np.array([state[0] for state in states])
            speeds = np.array([state[1] if len(state) > 1 else np.zeros(3) for state in states])  # order 1 has none
            for metric, off in (("position", places - data.path), ("velocity", speeds - velocity)):
                errors[name][metric].append(1000 * float(np.sqrt((off[data.counts] ** 2).sum(axis=1).mean())))
    return {
        name: {
            metric: {
                "rms": float(np.sqrt(np.mean(np.square(values)))),
                "ratio": np.exp(
                    interval(
                        [[math.log(own / other)] for own, other in zip(values, errors[_REFERENCE][metric], strict=True)]
                    )
                ).tolist(),
            }
            for metric, values in by_metric.items()
        }
        for name, by_metric in errors.items()
    }


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw the ratio of each error to that of order 3 over the frame rate, a panel for each kind of motion."""
    cells: Mapping[str, Mapping[str, Any]] = numbers["cells"]
    kinds = list(dict.fromkeys(name.rpartition(", ")[0] for name in cells))
    figure, axes = panels(2 * len(kinds), len(kinds), PAGE_IN / len(kinds), 1.9)
    for k, axis in enumerate(axes):
        metric = list(_METRICS)[k // len(kinds)]
        kind = kinds[k % len(kinds)]
        for name in _ORDERS:
            rows = np.array([cells[f"{kind}, {rate:g} Hz"][name][metric]["ratio"] for rate in RATES_HZ])
            (line,) = axis.plot(RATES_HZ, rows[:, 0], label=name)
            axis.fill_between(RATES_HZ, rows[:, 1], rows[:, 2], alpha=0.2, color=line.get_color())
        axis.set(xscale="log", yscale="log", ylim=(0.55, 2.2), title=kind)
        axis.set_xticks(RATES_HZ, [f"{rate:g}" for rate in RATES_HZ])
        axis.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS] if k % len(kinds) == 0 else [])
        axis.minorticks_off()
        axis.set_xlabel("Hz" if k >= len(kinds) else "", fontsize=7)
        axis.set_ylabel("" if k % len(kinds) else f"{_METRICS[metric]} / order 3", fontsize=7)
        axis.title.set_fontsize(8)
        axis.tick_params(labelsize=6)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=7)
    return figure


def table(numbers: dict[str, Any]) -> Table:
    """One row a kind of motion at 60 Hz: errors of order 3, and the others' ratios of the velocity's error to it."""
    shown = [name for name in _ORDERS if name not in (_REFERENCE, "order 1")]
    rows = []
    for scenario, cell in numbers["cells"].items():
        if scenario.endswith(f", {_TABLE_HZ:g} Hz"):
            errors = (f"{cell[_REFERENCE][metric]['rms']:.3g}" for metric in _METRICS)
            rows.append([scenario, *errors, *(estimate(cell[name]["velocity"]["ratio"]) for name in shown)])
    header = ["velocity's error against order 3's", "order 3 (mm/s)", "its position (mm)", *shown]
    return Table(header, rows)
