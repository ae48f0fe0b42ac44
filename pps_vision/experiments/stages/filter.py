"""The Kalman filter's order and smoother beside OpenCV's filter, on the same measurements.

Orders 1–4, with and without RTS smoothing, on the tracker's measurements of balls and markers, and on the table-tennis
flights of tt3d.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from pps_vision.errors import InputError
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.recordings import KINDS, Footage, of_kind
from pps_vision.experiments.films.score import steps_of
from pps_vision.experiments.study import TURNS, Method, Metric, SceneSource, Values, compare, rms
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, StereoView, View, sight
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Mask
from tracking import DEFAULT_ORDER, kalman
from tracking.kalman import Belief, KalmanParams, discretise
from tracking.smoother import Measurement, follow, smooth

DEFAULT = f"order {DEFAULT_ORDER}"
_SETTLED = 10  # measurements before a filter is judged
_PIXEL_STD = 2.0  # noise of the tt3d projections, found between the two cameras' rays
_METRICS = {"position_mm": Metric("position_mm", rms)}


@dataclass(frozen=True)
class Measurements:
    """Input of a filter and the truth; arrays have one row a measurement."""

    stamps_s: Array  # (n,)
    positions: Array  # (n, 3) m, measured
    covs: Array  # (n, 3, 3) m² of their white errors
    path: Array  # (n, 3) m, true
    distance_m: float  # distance from the eyes at the beginning
    counts: Mask  # (n,) where a filter is judged

    def params(self, order: int = DEFAULT_ORDER) -> KalmanParams:
        """Return the filter's defaults of an order for these measurements."""
        return kalman.scaled(KalmanParams.of_order(order), self.distance_m)

    def filtered(self, params: KalmanParams) -> list[Array]:
        """Return the states (order, 3) after each measurement."""
        belief = self.first(params)
        states = [belief.mean]
        for stamp_s, position, cov in self.later():
            belief = kalman.update(params, kalman.predict(params, belief, stamp_s), position, cov)
            states.append(belief.mean)
        return states

    def first(self, params: KalmanParams) -> Belief:
        """Return the belief after the first measurement."""
        return kalman.start(params, float(self.stamps_s[0]), self.positions[0], self.covs[0])

    def later(self) -> Iterator[tuple[float, Array, Array]]:
        """Yield stamp, position and covariance of the others."""
        for stamp_s, position, cov in zip(self.stamps_s[1:], self.positions[1:], self.covs[1:], strict=True):
            yield float(stamp_s), position, cov


Filter = Callable[[Measurements], list[Array]]  # the states (order, 3) after each measurement
chart = cells_chart("position_mm", "position error (mm RMS)", ("cv2",), DEFAULT, "time (ms per update)")


def run(study: Any) -> dict[str, Any]:
    """Return by data and filter: time of an update, error of the position."""

    def measured(source: SceneSource, number: int) -> Measurements:
        further, kind = divmod(number, len(KINDS))
        seed = study.seed + further
        return measurements(of_kind(list(KINDS)[kind], source, study.seconds, seed), seed)

    scenarios: dict[str, Callable[[int], Any]] = {source: partial(measured, source) for source in study.sources}
    n = len(KINDS) * -(-study.n // 4)  # one recording of each kind for four of other stages
    cells = compare(scenarios, methods(), _METRICS, range(n), "cv2", TURNS)
    folder = study.data / "tt3d"
    if not folder.exists():
        return {"cells": cells, "not_measured": f"tt3d: no {folder}"}
    thrown = flights(folder)
    cells |= compare({"tt3d": thrown.__getitem__}, methods(), _METRICS, range(len(thrown)), "cv2", TURNS)
    return {"cells": cells}


def measurements(recording: Footage, seed: int) -> Measurements:
    """Return our tracker's measurements in a recording, before its filter.

    Raises:
        InputError: The tracker detected nothing.
    """
    steps, _ = steps_of(recording, seed)
    observations = [step.observation for step in steps if step.observation is not None]
    known = [k for k, step in enumerate(steps) if step.observation is not None]
    if not known:
        raise InputError("bench stages", f"no object detected with seed {seed}; expected longer recordings")
    return Measurements(
        np.array([o.stamp_s for o in observations]),
        np.array([o.p_root for o in observations]),
        np.array([o.cov_root - o.correlated_cov_root for o in observations]),
        recording.position[known],
        float(np.linalg.norm(sight(steps[known[0]].centers_root, observations[0].p_root))),
        (~recording.jumped[known]) & (np.arange(len(known)) >= _SETTLED),
    )


def methods() -> dict[str, Method]:
    """Return the filters and smoothers by name."""
    filters: dict[str, Filter] = {
        **{f"order {order}": partial(_ours, order) for order in (1, 2, 3, 4)},
        **{f"order {order}, RTS": partial(_smoothed, order) for order in (2, 3, 4)},
        "cv2": opencv_states,
    }
    return {name: partial(_run, states_of) for name, states_of in filters.items()}


def _run(states_of: Filter, data: Measurements, seed: int) -> Values:
    """Errors of a filter with its processor time per update."""
    states, ms = timed(partial(states_of, data))
    error_mm = 1000 * np.linalg.norm(np.array(states)[:, 0] - data.path, axis=1)
    return {"position_mm": error_mm[data.counts], "ms": [ms / len(data.stamps_s)]}


def _ours(order: int, data: Measurements) -> list[Array]:
    return data.filtered(data.params(order))


def _smoothed(order: int, data: Measurements) -> list[Array]:
    params = data.params(order)
    passages = follow(params, data.first(params), [Measurement(*row) for row in data.later()])
    return [belief.mean for belief in smooth(passages)]


def opencv_states(data: Measurements) -> list[Array]:
    """Return the states of OpenCV's filter with our filter's model.

    As in an application, its matrices are computed only where the step of time has changed.
    """
    params = data.params()
    first = data.first(params)
    n = first.mean.size
    kf = cv2.KalmanFilter(n, 3, 0, cv2.CV_64F)
    kf.measurementMatrix = np.eye(3, n)
    kf.statePost = first.mean.reshape(n, 1).copy()
    kf.errorCovPost = first.cov.copy()  # it writes into them
    states = [first.mean]
    last_s = first.stamp_s
    dt_s = np.nan
    for stamp_s, position, cov in data.later():
        if not abs(stamp_s - last_s - dt_s) <= 1e-6:
            dt_s = stamp_s - last_s
            A, Q = discretise(params.order, dt_s, params.decay_s)
            kf.transitionMatrix = np.kron(A, np.eye(3))
            kf.processNoiseCov = np.kron(params.noise_density * Q, np.eye(3))
        last_s = stamp_s
        kf.measurementNoiseCov = cov
        kf.predict()
        states.append(np.array(kf.correct(position.reshape(3, 1)), dtype=float).reshape(-1, 3))
    return states


def flights(folder: Path) -> list[Measurements]:
    """Return every noisy flight of a tt3d folder, triangulated from its two cameras."""
    view = StereoView(camera_of(folder / "side.yaml"), camera_of(folder / "oblique.yaml"))
    return [_thrown(file, folder / "oblique" / file.name, view) for file in sorted((folder / "side").glob("*.csv"))]


def camera_of(file: Path) -> View:
    """Read rvec, tvec (world to camera), f, w, h.

    The principal point is in the middle of the image.
    """
    values = yaml.safe_load(file.read_text())
    width, height, focal = (values[name] for name in "whf")
    T_camera_world = transform(cv2.Rodrigues(np.array(values["rvec"]))[0], values["tvec"])
    return View(Camera(width, height, focal, focal, width / 2, height / 2), inverse(T_camera_world))


def _thrown(side_file: Path, oblique_file: Path, view: StereoView) -> Measurements:
    side, oblique = (np.genfromtxt(file, delimiter=",", names=True) for file in (side_file, oblique_file))
    noise = _PIXEL_STD**2 * np.eye(2)
    pixels = zip(np.stack([side["u"], side["v"]], 1), np.stack([oblique["u"], oblique["v"]], 1), strict=True)
    triangulated = [triangulate(view, left, right, noise, noise) for left, right in pixels]
    valid = [k for k, point in enumerate(triangulated) if point is not None]
    points = [point for point in triangulated if point is not None]
    positions = np.array([point.p_root for point in points])
    truth = np.stack([side["X"], side["Y"], side["Z"]], axis=1)[valid]
    return Measurements(
        stamps_s=side["Timestamp"][valid],
        positions=positions,
        covs=np.array([point.cov_root for point in points]),
        path=truth,
        distance_m=float(np.linalg.norm(positions[0] - view.midpoint)),
        counts=np.ones(len(valid), bool),
    )
