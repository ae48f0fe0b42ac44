"""The whole pipeline, from stereo pairs to a track and a time to contact: ours beside OpenCV's trackers and SGBM."""

from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.baselines.stereo_pipelines import StereoPipelineName
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.scenarios import Footage, moving
from pps_vision.experiments.score import METRICS, baseline_tracks, judge, steps_of
from pps_vision.experiments.study import TURNS, Metric, SceneSource, TrackingStudy, Values, compare, median
from pps_vision.experiments.tables import Table, estimate, judged, median_first
from pps_vision.types import Array, Track3D

OURS = {"ours, generic": "generic", "ours, marker": "marker"}
BASELINES: tuple[StereoPipelineName, ...] = get_args(StereoPipelineName)
_SPEEDS_M_S = (0.05, 0.30)
_FARTHEST_M = 0.30  # an approach starts no farther from where it ends
_LAST_S = (0.04, 0.5)  # before the touch: where a time to contact counts
GOAL_MS = {"ours, generic": 4.5, "ours, marker": 0.8}
"""Largest median time of a pair with what each is for: a ball, a marker."""
MEANT_FOR = {"ball": "ours, generic", "marker": "ours, marker"}
"""Pipeline of ours by object."""
_METRICS = {
    "rms_mm": METRICS["rms_mm"],
    "near_percent": METRICS["near_percent"],
    "ttc_percent": Metric("ttc_percent", median),
}


@dataclass(frozen=True)
class Pipeline(TrackingStudy):
    """Balls and markers that approach the skin at 5–30 cm/s while the head moves, through our pipelines and baselines.

    Baselines are told the true boxes in the first frame and get our filter. Times are of each pipeline alone.
    """

    def run(self) -> dict[str, Any]:
        """Return by scenes and pipeline: 3D RMS error, error of the time to contact, time and its ratio to CSRT."""
        methods = {name: partial(_ours, mode) for name, mode in OURS.items()}
        methods |= {name: partial(_baseline, name) for name in BASELINES}
        scenarios = self.scenarios(self._film, ("ball", "marker"))
        return {"cells": compare(scenarios, methods, _METRICS, self.seeds, "two CSRT", TURNS)}

    def _film(self, stimulus: str, source: SceneSource, seed: int) -> Footage:
        speeds = np.geomspace(*_SPEEDS_M_S, self.n) if self.n > 1 else np.array([0.15])
        speed = float(speeds[seed - self.seed])
        return moving(stimulus, "approach", seed, _FARTHEST_M / speed + 0.1, source, speed=speed)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against 3D error, one panel for each kind of scene."""
        return speed_errors(numbers["cells"], "rms_mm", "3D RMS error (mm)", BASELINES, "ours, generic")

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one table for each kind of scene, one row a pipeline; a time above its goal is bold."""
        header = ["pipeline", "3D RMS (mm)", "tracked (%)", "time to contact (%)", "ms, quartiles", "ratio to two CSRT"]
        tables = {}
        for name, methods in numbers["cells"].items():
            for_it = MEANT_FOR[name.rsplit(", ", 1)[1]]
            rows = []
            for m, c in methods.items():
                missed = m == for_it and c["ms"][1] > GOAL_MS[m]
                ms = judged(median_first(c["ms"]), missed)
                rows.append([m, *(estimate(c[key]) for key in _METRICS), ms, estimate(c["ratio"])])
            tables[name.replace(", ", "_")] = Table(header, rows)
        return tables


def _ours(mode: str, recording: Footage, seed: int) -> Values:
    steps, ms = steps_of(recording, seed, mode)
    return _values(recording, [step.track for step in steps], ms)


def _baseline(name: StereoPipelineName, recording: Footage, seed: int) -> Values:
    return _values(recording, *baseline_tracks(recording, name))


def _values(recording: Footage, tracks: list[Track3D], ms: list[float]) -> Values:
    """Judge the frames before the object arrives; a missing time to contact is 100 % off."""
    speed = np.linalg.norm(recording.velocity, axis=1)
    arrived = np.flatnonzero(speed < 0.5 * speed[0])
    if not len(arrived):
        raise ValueError("the object does not arrive; expected a recording of a whole approach")
    last, way = int(arrived[0]), recording.velocity[0] / speed[0]
    end = recording.position[last]
    ttc = []
    for track, position in zip(tracks[:last], recording.position, strict=False):
        true_s = float((end - position) @ way) / speed[0]
        if _LAST_S[0] < true_s <= _LAST_S[1]:
            ttc.append(100 * ttc_error(track, end, way, true_s))
    return judge(recording, tracks) | {"ttc_percent": np.array(ttc), "ms": np.array(ms[1:])}


def ttc_error(track: Track3D, end: Array, way: Array, true_s: float) -> float:
    """Return the relative error of the time until the plane through `end` (3,) across the `way` (3,) is met.

    1 where the track is unknown or does not approach.
    """
    closing = float(track.velocity @ way)
    if not (track.is_known and closing > 0):
        return 1.0
    return abs(float((end - track.position) @ way) / closing - true_s) / true_s
