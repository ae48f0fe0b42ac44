"""`track --max-error-mm`: time and stated error of its configurations, and whether it keeps what it promises."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.budget import CONFIGURATIONS, cheapest
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.scenarios import Recording, moving
from pps_vision.experiments.score import METRICS, judge, timed_steps
from pps_vision.experiments.study import Method, Metric, SceneSource, TrackingStudy, Values, compare, mean, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Status
from tracking.tracker import Tracker, TrackerParams

ASKED_MM = (0.3, 1.0, 3.0, 10.0)
DEFAULT = CONFIGURATIONS[-1].name
_SETTLED = 10  # frames with a track before the covariance counts
_OBJECTS = ("ball", "marker", "cube")
_METRICS = {
    "rms_mm": METRICS["rms_mm"],
    "near_percent": METRICS["near_percent"],
    "true_over_reported": Metric("true_over_reported", median),
}
_KEPT = {"promised": Metric("promised", mean), "kept": Metric("kept", mean), "cost": Metric("cost", median)}


@dataclass(frozen=True)
class Budget(TrackingStudy):
    """Balls, markers and cubes tracked by each configuration of `track --max-error-mm`, then by the one it chooses.

    *Promised*: its expected error is within the limit. *Kept*: the 3D RMS error then is, of what was promised.
    """

    seconds: float = 4.0
    """Length of a recording."""

    def run(self) -> dict[str, Any]:
        """Return by scenes and configuration time and errors; by limit the shares promised and kept, and the cost."""
        scenarios = self.scenarios(self._film, _OBJECTS)
        scenarios.pop("independent, cube", None)  # the ray caster has no cubes
        methods = {c.name: partial(_values, c.params) for c in CONFIGURATIONS}
        limits: dict[str, Method] = {f"{mm:g} mm": partial(_request, mm) for mm in ASKED_MM}
        return {
            "cells": compare(scenarios, methods, _METRICS, self.seeds, reference=DEFAULT),
            "requests": compare(scenarios, limits, _KEPT, range(self.seed + 100, self.seed + 100 + self.n)),
        }

    def _film(self, name: str, source: SceneSource, seed: int) -> Recording:
        motion = ("circle", "linear", "jerk", "figure8")[seed % 4]
        return moving(name, motion, seed, self.seconds, source)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against error of the configurations, one panel for each kind of scene."""
        return speed_errors(numbers["cells"], {"rms_mm": "3D RMS error (mm)"}, (), DEFAULT)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the configurations' times and ratios of true to stated error, and the requests."""
        rows = [
            [f"{scene}: {name}", f"{c['ms'][1]:.2f}", *(estimate(c[key]) for key in _METRICS)]
            for scene, cell in numbers["cells"].items()
            for name, c in cell.items()
        ]
        requests = [
            [f"{scene}: {limit}", *(estimate(c[key], 2) for key in _KEPT)]
            for scene, cell in numbers["requests"].items()
            for limit, c in cell.items()
        ]
        header = ["scenes: configuration", "ms per pair", "3D RMS (mm)", "near (%)", "true / stated error"]
        asked = ["scenes: limit", "promised", "kept, of the promised", "time, of the default's"]
        return {"": Table(header, rows), "requests": Table(asked, requests)}


def _values(params: TrackerParams, recording: Recording, seed: int) -> Values:
    """Errors, times, and the ratio of the true RMS error to the stated one, of the frames with a settled track."""
    tracker = Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)
    steps, ms = timed_steps(tracker.step, recording.frames)
    tracks = [step.track for step in steps]
    settled = [k for k, track in enumerate(tracks) if track.status == Status.TRACKING][_SETTLED:]
    true = [np.sum((tracks[k].position - recording.position[k]) ** 2) for k in settled]
    stated = [np.trace(tracks[k].cov[:3, :3]) for k in settled]
    ratio = [float(np.sqrt(np.mean(true) / np.mean(stated)))] if settled else []
    return judge(recording, tracks) | {"ms": ms, "true_over_reported": ratio}


def _request(limit_mm: float, recording: Recording, seed: int) -> Values:
    """Whether the choice promises the limit, whether it keeps it, and its time relative to the default's."""

    def tracker_for(params: TrackerParams) -> Tracker:
        return Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)

    chosen: Callable[..., Values] = partial(_values, seed=seed, recording=recording)
    choice = cheapest(recording.frames, limit_mm, tracker_for)
    ours, default = chosen(choice.configuration.params), chosen(TrackerParams())
    kept = METRICS["rms_mm"].summary(np.asarray(ours["error_mm"])) <= limit_mm
    cost = float(np.median(np.asarray(ours["ms"])) / np.median(np.asarray(default["ms"])))
    return {"promised": [choice.meets], "kept": [kept] if choice.meets else [], "cost": [cost], "ms": ours["ms"]}
