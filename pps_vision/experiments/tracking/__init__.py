"""How accurately, how surely and how fast an object is tracked while the head moves, with calibrated covariances."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import STEREO_PIPELINES, available_pipelines
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.experiments.films.score import METRICS, baseline, tracker
from pps_vision.experiments.study import TURNS, Method, Part, PartsStudy, SceneSource, TrackingStudy, Values, compare
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.tracking import consistency
from rendering.names import MotionName

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")
_ACCURACY_METRICS = {name: METRICS[name] for name in ("mean_recording_mm", "worst_recording_mm", "near_percent")}
OURS = {"ours, generic": "generic", "ours, marker": "marker"}
GOAL_MS = {"ours, generic": 4.5, "ours, marker": 0.8}  # largest median time of a pair with the object of `MEANT_FOR`
MEANT_FOR = {"ball": "ours, generic", "marker": "ours, marker"}  # our pipeline for each object
_SPEEDS_M_S = (0.05, 0.30)
_FARTHEST_M = 0.30  # largest distance from the start of an approach to its end
_PIPELINE_CHART = cells_chart("rms_mm", "3D RMS error (mm)", STEREO_PIPELINES, "ours, generic")
_PIPELINE_METRICS = {name: METRICS[name] for name in ("rms_mm", "near_percent")}


def _accuracy(study: "Tracking") -> dict[str, Any]:
    """Balls (generic tracker) and markers (marker tracker) at 5–15 cm/s; judged from 0.5 s on.

    Returns by source and object the RMS error of a recording (mean, worst), tracked frames and time.
    """

    def film(stimulus: str, source: SceneSource, seed: int) -> Footage:
        motion = MOTIONS[(seed - study.seed) % len(MOTIONS)]
        return moving(stimulus, motion, seed, study.seconds, source)

    scenarios = study.scenarios(film, ("ball", "marker"))
    return {"cells": compare(scenarios, {"tracker": tracker()}, _ACCURACY_METRICS, study.seeds, repeated=TURNS)}


def _accuracy_table(numbers: dict[str, Any]) -> Table:
    rows = []
    for name, methods in numbers["cells"].items():
        cell = methods["tracker"]
        rows.append([name, *(estimate(cell[key]) for key in (*_ACCURACY_METRICS, "ms"))])
    header = ["scenes", "RMS of a recording (mm)", "worst recording (mm)", "tracked (%)", "ms per pair, quartiles"]
    return Table(header, rows)


def _pipeline(study: "Tracking") -> dict[str, Any]:
    """Balls and markers that approach the skin at 5–30 cm/s while the head moves; beside OpenCV's trackers.

    Baselines get the true boxes of the first frame and our filter. Returns by scenes and pipeline the 3D RMS error and
    the processor time with its ratio to CSRT.
    """
    n = study.n_approaches
    speeds = np.geomspace(*_SPEEDS_M_S, n) if n > 1 else np.array([0.15])

    def film(stimulus: str, source: SceneSource, seed: int) -> Footage:
        speed = float(speeds[seed - study.seed])
        return moving(stimulus, "approach", seed, _FARTHEST_M / speed + 0.1, source, speed=speed)

    methods: dict[str, Method] = {name: partial(_warm, tracker(mode)) for name, mode in OURS.items()}
    methods |= {name: partial(_warm, baseline(name)) for name in available_pipelines()}
    scenarios = study.scenarios(film, ("ball", "marker"))
    seeds = range(study.seed, study.seed + n)
    return {"cells": compare(scenarios, methods, _PIPELINE_METRICS, seeds, "two CSRT", TURNS)}


def _warm(method: Method, recording: Footage, seed: int) -> Values:
    """A method's values without the time of its first frame."""
    values = method(recording, seed)
    return {**values, "ms": np.asarray(values["ms"])[1:]}


@dataclass(frozen=True)
class Tracking(PartsStudy, TrackingStudy):
    """Accuracy of the tracker, consistency of its covariance, and the whole pipeline beside baselines."""

    MINUTES: ClassVar[int] = 27
    PARTS: ClassVar[Mapping[str, Part]] = {
        "accuracy": Part(_accuracy, table=_accuracy_table),
        "consistency": Part(consistency.run, table=consistency.table),
        "pipeline": Part(_pipeline, _PIPELINE_CHART),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_consistency": 1, "n_approaches": 1}

    n: int = 8  # recordings of each object for the accuracy, their motions by turns
    seconds: float = 5.0  # length of the recordings, approaches at a given speed apart
    n_consistency: int = 4  # recordings of each kind for the consistency
    n_approaches: int = 4  # approaches of each object for the pipeline
