"""The Kalman filter's order, gain and smoother beside OpenCV's and filterpy's filters, on the same measurements."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from pps_vision.errors import InputError
from pps_vision.experiments.baselines.filters import ConstantGain, FilterPyFilter, OpenCVFilter
from pps_vision.experiments.baselines.filters import Filter as OnlineFilter
from pps_vision.experiments.charts import PAGE_IN, panels, speed_error
from pps_vision.experiments.films.recordings import KINDS, Footage, of_kind
from pps_vision.experiments.films.score import steps_of
from pps_vision.experiments.study import (
    DATA,
    TURNS,
    Method,
    Metric,
    SceneSource,
    TrackingStudy,
    Values,
    compare,
    median,
    rms,
)
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, StereoView, View
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Mask
from tracking import DEFAULT_ORDER, kalman
from tracking.kalman import Belief, KalmanParams
from tracking.smoother import Measurement, follow, smooth

DEFAULT = f"order {DEFAULT_ORDER}"
BASELINES = ("cv2", "filterpy")
GOAL_TT3D_MM = {DEFAULT: 17.3, f"{DEFAULT}, RTS": 12.1}
"""Largest position error of the default filter on tt3d, and smoothed."""
_SETTLED = 10  # measurements before a filter is judged
_LATE_S = (0.02, 0.5)
_PIXEL_STD = 2.0  # of the noisy tt3d projections, found between the two cameras' rays
_METRICS = {
    "position_mm": Metric("position_mm", rms),
    "velocity_mm_s": Metric("velocity_mm_s", rms),
    "ttc_percent": Metric("ttc_percent", median),
}


@dataclass(frozen=True)
class Measurements:
    """What a filter gets and what it should make of it; arrays have one row a measurement."""

    stamps_s: Array
    """(n,)"""
    positions: Array
    """(n, 3) m, measured."""
    covs: Array
    """(n, 3, 3) m² of them."""
    path: Array
    """(n, 3) m, true."""
    velocity: Array
    """(n, 3) m/s, true; NaN where it is not known."""
    distance_m: float
    """Distance from the eyes at the beginning."""
    counts: Mask
    """(n,) where a filter is judged."""
    touched: Array
    """(3,) point that is touched at the end; NaN if none."""
    ttc_s: Array
    """(n,) time until then; NaN if it is not touched."""
    radius_m: float = 0.0
    """The object's."""
    white_share: float = KalmanParams().white_share
    """Share of the measured variance that is new with every frame."""

    def params(self, order: int = DEFAULT_ORDER) -> KalmanParams:
        """Return the filter's defaults of an order for these measurements."""
        return kalman.scaled(replace(KalmanParams.of_order(order), white_share=self.white_share), self.distance_m)

    def first(self, params: KalmanParams) -> Belief:
        """Return the belief after the first measurement."""
        return kalman.start(params, float(self.stamps_s[0]), self.positions[0], self.covs[0])

    def later(self) -> Iterator[tuple[float, Array, Array]]:
        """Yield stamp, position and covariance of the others."""
        for stamp_s, position, cov in zip(self.stamps_s[1:], self.positions[1:], self.covs[1:], strict=True):
            yield float(stamp_s), position, cov


@dataclass(frozen=True)
class Filter(TrackingStudy):
    """Filters of orders 1–4, with constant gain, and with RTS smoothing, beside OpenCV's and filterpy's, on what the
    tracker measured of balls and markers, and on the table-tennis flights of tt3d."""

    n: int = 1
    """Recordings of each object on each motion and at each speed of approach."""
    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    data: Path = DATA
    """Folder that holds tt3d (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return by data and filter: time of an update, errors of position, velocity and time to contact."""
        scenarios: dict[str, Callable[[int], Any]] = {
            source: partial(self._measured, source) for source in self.sources
        }
        cells = compare(scenarios, methods(), _METRICS, range(len(KINDS) * self.n), "cv2", TURNS)
        folder = self.data / "tt3d"
        if not folder.exists():
            return {"cells": cells, "skipped": f"tt3d: no {folder}"}
        thrown = flights(folder)
        return {
            "cells": cells
            | compare({"tt3d": thrown.__getitem__}, methods(), _METRICS, range(len(thrown)), "cv2", TURNS)
        }

    def _measured(self, source: SceneSource, number: int) -> Measurements:
        further, kind = divmod(number, len(KINDS))
        seed = self.seed + further
        return measurements(of_kind(list(KINDS)[kind], source, self.seconds, seed), seed)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against the error of the position, forward and smoothed, one panel for each kind of data."""
        cells = numbers["cells"]
        figure, axes = panels(len(cells), 1, PAGE_IN, 3.0)
        for axis, (name, methods) in zip(axes, cells.items(), strict=True):
            axis.set_title(name, fontsize=10)
            label = "position error (mm RMS)"
            speed_error(axis, methods, "position_mm", BASELINES, DEFAULT, "time (ms per update)", label)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one table for each kind of data, one row a filter; an error above its goal is bold."""
        header = ["filter", "position (mm)", "velocity (mm/s)", "time to contact (%)", "ratio of time to cv2"]
        tables = {}
        for name, cell in numbers["cells"].items():
            rows = []
            for m, c in cell.items():
                missed = name == "tt3d" and round(c["position_mm"][0], 1) > GOAL_TT3D_MM.get(m, np.inf)
                others = (estimate(c[key]) for key in list(_METRICS)[1:])
                rows.append([m, judged(estimate(c["position_mm"]), missed), *others, estimate(c["ratio"], 2)])
            tables[name] = Table(header, rows)
        return tables


def measurements(recording: Footage, seed: int) -> Measurements:
    """Return what our tracker measured in a recording, before its filter.

    Raises:
        InputError: where it found nothing.
    """
    steps, _ = steps_of(recording, seed)
    known = [k for k, step in enumerate(steps) if step.observation is not None]
    if not known:
        raise InputError("bench filter", f"nothing was found in a recording of seed {seed}; expected longer recordings")
    seen = [one for one in (steps[k].observation for k in known) if one is not None]
    touched, ttc = recording.touch()
    return Measurements(
        np.array([one.stamp_s for one in seen]),
        np.array([one.p_root for one in seen]),
        np.array([one.cov_root for one in seen]),
        recording.position[known],
        recording.velocity[known],
        float(np.linalg.norm(seen[0].p_root - steps[known[0]].midpoint_root)),
        (~recording.jumped[known]) & (np.arange(len(known)) >= _SETTLED),
        touched,
        ttc[known],
        recording.radius_m,
    )


def methods() -> dict[str, Method]:
    """Return the filters and smoothers by name."""
    ours = {f"order {order}": partial(_online, partial(_Ours, order)) for order in (1, 2, 3, 4)}
    smoothed = {f"order {order}, RTS": partial(_smoothed, order) for order in (2, 3, 4)}
    steady = {"constant gain": partial(_online, _steady)}
    libraries: dict[str, Callable[[KalmanParams, Belief], OnlineFilter]] = {
        "cv2": OpenCVFilter,
        "filterpy": FilterPyFilter,
    }
    baselines = {name: partial(_online, partial(_baseline, make)) for name, make in libraries.items()}
    return {name: partial(_per_update, run) for name, run in {**ours, **smoothed, **steady, **baselines}.items()}


def _per_update(run: Method, data: Measurements, seed: int) -> Values:
    """Return a filter's values with its processor time per update."""
    values, ms = timed(partial(run, data, seed))
    return {**values, "ms": [ms / len(data.stamps_s)]}


class _Ours:
    """Our filter of an order with the interface of the baselines."""

    def __init__(self, order: int, data: Measurements) -> None:
        self.params = data.params(order)
        self.belief = data.first(self.params)

    def step(self, stamp_s: float, position: Array, cov: Array) -> Array:
        """Predict and update."""
        self.belief = kalman.update(self.params, kalman.predict(self.params, self.belief, stamp_s), position, cov)
        return self.belief.mean


def _baseline(make: Callable[[KalmanParams, Belief], OnlineFilter], data: Measurements) -> OnlineFilter:
    return make(data.params(), data.first(data.params()))


def _steady(data: Measurements) -> OnlineFilter:
    variance = float(np.median(np.trace(data.covs, axis1=1, axis2=2))) / 3
    return ConstantGain(data.params(), data.first(data.params()), variance, float(np.median(np.diff(data.stamps_s))))


def _online(make: Callable[[Measurements], OnlineFilter], data: Measurements, seed: int) -> Values:
    one = make(data)
    first = data.first(data.params())
    states = [first.mean[:1], *(one.step(*row).copy() for row in data.later())]
    return errors(data, states)


def _smoothed(order: int, data: Measurements, seed: int) -> Values:
    params = data.params(order)
    passages = follow(params, data.first(params), [Measurement(*row) for row in data.later()])
    return errors(data, [belief.mean for belief in smooth(passages)])


def errors(data: Measurements, states: list[Array]) -> dict[str, Array]:
    """Return the errors where a filter is judged; no velocity and time to contact of a filter without velocity."""
    p = np.array([state[0] for state in states])
    found = {"position_mm": 1000 * np.linalg.norm(p - data.path, axis=1)[data.counts]}
    if len(states[-1]) < 2:
        return found
    v = np.array([state[1] if len(state) > 1 else np.zeros(3) for state in states])
    found["velocity_mm_s"] = (
        1000 * np.linalg.norm(v - data.velocity, axis=1)[data.counts & np.isfinite(data.velocity[:, 0])]
    )
    late = data.counts & (data.ttc_s > _LATE_S[0]) & (data.ttc_s <= _LATE_S[1])
    line = p[late] - data.touched
    distance = np.linalg.norm(line, axis=1)
    closing = -np.einsum("ij,ij->i", line, v[late]) / distance
    ttc = np.where(closing > 0, (distance - data.radius_m) / np.where(closing > 0, closing, 1.0), np.inf)
    return found | {"ttc_percent": 100 * np.abs(ttc / data.ttc_s[late] - 1)}


def flights(folder: Path) -> list[Measurements]:
    """Return every noisy flight of a tt3d folder, triangulated from its two cameras."""
    view = StereoView(_camera(folder / "side.yaml"), _camera(folder / "oblique.yaml"))
    return [_thrown(file, folder / "oblique" / file.name, view) for file in sorted((folder / "side").glob("*.csv"))]


def _camera(file: Path) -> View:
    """Read lines `name: number or [numbers]`: rvec, tvec (world to camera), f, w, h; the principal point is amid."""
    of = {name: json.loads(value) for name, value in (s.split(":", 1) for s in file.read_text().splitlines() if s)}
    T_camera_world = transform(cv2.Rodrigues(np.array(of["rvec"]))[0], of["tvec"])
    return View(Camera(of["w"], of["h"], of["f"], of["f"], of["w"] / 2, of["h"] / 2), inverse(T_camera_world))


def _thrown(side: Path, oblique: Path, view: StereoView) -> Measurements:
    one, other = (np.genfromtxt(file, delimiter=",", names=True) for file in (side, oblique))
    noise = _PIXEL_STD**2 * np.eye(2)
    pixels = zip(np.stack([one["u"], one["v"]], 1), np.stack([other["u"], other["v"]], 1), strict=True)
    points = [triangulate(view, left, right, noise, noise) for left, right in pixels]
    kept = [k for k, point in enumerate(points) if point is not None]
    found = [point for point in points if point is not None]
    truth = np.stack([one["X"], one["Y"], one["Z"]], axis=1)[kept]
    positions, unknown = np.array([point.p_root for point in found]), np.full(len(kept), np.nan)
    return Measurements(
        one["Timestamp"][kept],
        positions,
        np.array([point.cov_root for point in found]),
        truth,
        np.full_like(truth, np.nan),
        float(np.linalg.norm(positions[0] - view.midpoint)),
        np.ones(len(kept), bool),
        np.full(3, np.nan),
        unknown,
        white_share=1.0,
    )
