"""How accurately, how surely and how fast an object is tracked while the head moves, with calibrated covariances."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.baselines.stereo_pipelines import StereoPipelineName
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.experiments.films.score import METRICS, baseline_tracks, judge, steps_of, tracker
from pps_vision.experiments.study import (
    TURNS,
    Metric,
    Part,
    PartsStudy,
    SceneSource,
    TrackingStudy,
    Values,
    compare,
    median,
)
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.experiments.tracking import consistency
from pps_vision.types import Array, Track3D
from rendering.names import MotionName

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")
_ACCURACY_METRICS = {name: METRICS[name] for name in ("mean_recording_mm", "worst_recording_mm", "near_percent")}
OURS = {"ours, generic": "generic", "ours, marker": "marker"}
BASELINES: tuple[StereoPipelineName, ...] = get_args(StereoPipelineName)
GOAL_MS = {"ours, generic": 4.5, "ours, marker": 0.8}  # largest median time of a pair with the object of `MEANT_FOR`
MEANT_FOR = {"ball": "ours, generic", "marker": "ours, marker"}  # our pipeline for each object
_SPEEDS_M_S = (0.05, 0.30)
_FARTHEST_M = 0.30  # largest distance from the start of an approach to its end
_LAST_S = (0.04, 0.5)  # before the touch, where the time to contact counts
_PIPELINE_METRICS = {
    "rms_mm": METRICS["rms_mm"],
    "near_percent": METRICS["near_percent"],
    "ttc_percent": Metric("ttc_percent", median),
}


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
        rows.append([name, *(estimate(cell[key]) for key in _ACCURACY_METRICS), median_first(cell["ms"])])
    header = ["scenes", "RMS of a recording (mm)", "worst recording (mm)", "tracked (%)", "ms per pair, quartiles"]
    return Table(header, rows)


def _consistency(study: "Tracking") -> dict[str, Any]:
    seeds = range(study.seed, study.seed + study.n_consistency)
    return consistency.measure_coverage(study.sources, seeds, study.seconds)


def _pipeline(study: "Tracking") -> dict[str, Any]:
    """Balls and markers that approach the skin at 5–30 cm/s while the head moves; beside OpenCV's trackers and SGBM.

    Baselines get the true boxes of the first frame and our filter. Returns by scenes and pipeline the 3D RMS error, the
    error of the time to contact, and the processor time with its ratio to CSRT.
    """
    n = study.n_approaches
    speeds = np.geomspace(*_SPEEDS_M_S, n) if n > 1 else np.array([0.15])

    def film(stimulus: str, source: SceneSource, seed: int) -> Footage:
        speed = float(speeds[seed - study.seed])
        return moving(stimulus, "approach", seed, _FARTHEST_M / speed + 0.1, source, speed=speed)

    methods = {name: partial(_our_pipeline, mode) for name, mode in OURS.items()}
    methods |= {name: partial(_baseline_pipeline, name) for name in BASELINES}
    scenarios = study.scenarios(film, ("ball", "marker"))
    seeds = range(study.seed, study.seed + n)
    return {"cells": compare(scenarios, methods, _PIPELINE_METRICS, seeds, "two CSRT", TURNS)}


def _pipeline_chart(numbers: dict[str, Any]) -> Figure:
    """Draw time against 3D error, one panel for each kind of scene."""
    return speed_errors(numbers["cells"], "rms_mm", "3D RMS error (mm)", BASELINES, "ours, generic")


def _our_pipeline(mode: str, recording: Footage, seed: int) -> Values:
    steps, ms = steps_of(recording, seed, mode)
    return _pipeline_values(recording, [step.track for step in steps], ms)


def _baseline_pipeline(name: StereoPipelineName, recording: Footage, seed: int) -> Values:
    return _pipeline_values(recording, *baseline_tracks(recording, name))


def _pipeline_values(recording: Footage, tracks: list[Track3D], ms: list[float]) -> Values:
    """Judge the frames before the object arrives; a missing time to contact counts as 100 % off."""
    speed = np.linalg.norm(recording.velocity, axis=1)
    arrived = np.flatnonzero(speed < 0.5 * speed[0])
    if not len(arrived):
        raise ValueError("the object does not arrive; expected a recording of a whole approach")
    last = int(arrived[0])
    heading = recording.velocity[0] / speed[0]
    end = recording.position[last]
    ttc = []
    for track, position in zip(tracks[:last], recording.position, strict=False):
        true_s = float((end - position) @ heading) / speed[0]
        if _LAST_S[0] < true_s <= _LAST_S[1]:
            ttc.append(100 * ttc_error(track, end, heading, true_s))
    return judge(recording, tracks) | {"ttc_percent": np.array(ttc), "ms": np.array(ms[1:])}


def ttc_error(track: Track3D, end: Array, heading: Array, true_s: float) -> float:
    """Return the relative error of the time until the track meets the plane through `end` (3,) across `heading` (3,).

    1 where the track is unknown or does not approach.
    """
    closing = float(track.velocity @ heading)
    if not (track.is_known and closing > 0):
        return 1.0
    return abs(float((end - track.position) @ heading) / closing - true_s) / true_s


@dataclass(frozen=True)
class Tracking(PartsStudy, TrackingStudy):
    """Accuracy of the tracker, consistency of its covariance, and the whole pipeline beside baselines."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "accuracy": Part(_accuracy, table=_accuracy_table),
        "consistency": Part(_consistency, table=consistency.table),
        "pipeline": Part(_pipeline, _pipeline_chart),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_consistency": 1, "n_approaches": 1}

    n: int = 20  # recordings of each object for the accuracy, their motions by turns
    seconds: float = 5.0  # length of the recordings, approaches at a given speed apart
    n_consistency: int = 4  # recordings of each kind for the consistency
    n_approaches: int = 4  # approaches of each object for the pipeline
