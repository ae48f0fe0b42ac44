"""How accurately, how surely and how fast an object is tracked while the head moves, with calibrated covariances."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.experiments.films.score import METRICS, tracker
from pps_vision.experiments.study import TURNS, Part, PartsStudy, SceneSource, TrackingStudy, compare
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.experiments.tracking import consistency, pipeline
from rendering.names import MotionName

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")
_METRICS = {name: METRICS[name] for name in ("mean_recording_mm", "worst_recording_mm", "near_percent")}


def _accuracy(study: "Tracking") -> dict[str, Any]:
    """Balls (generic tracker) and markers (marker tracker) at 5–15 cm/s; judged from 0.5 s on.

    Returns by source and object the RMS error of a recording (mean, worst), tracked frames and time.
    """

    def film(stimulus: str, source: SceneSource, seed: int) -> Footage:
        motion = MOTIONS[(seed - study.seed) % len(MOTIONS)]
        return moving(stimulus, motion, seed, study.seconds, source)

    scenarios = study.scenarios(film, ("ball", "marker"))
    return {"cells": compare(scenarios, {"tracker": tracker()}, _METRICS, study.seeds, repeated=TURNS)}


def _accuracy_table(numbers: dict[str, Any]) -> Table:
    rows = []
    for name, methods in numbers["cells"].items():
        cell = methods["tracker"]
        rows.append([name, *(estimate(cell[key]) for key in _METRICS), median_first(cell["ms"])])
    header = ["scenes", "RMS of a recording (mm)", "worst recording (mm)", "tracked (%)", "ms per pair, quartiles"]
    return Table(header, rows)


def _consistency(study: "Tracking") -> dict[str, Any]:
    seeds = range(study.seed, study.seed + study.n_consistency)
    return consistency.measure_coverage(study.sources, seeds, study.seconds)


def _pipeline(study: "Tracking") -> dict[str, Any]:
    return pipeline.compare_pipelines(study.scenarios, study.seed, study.n_approaches)


@dataclass(frozen=True)
class Tracking(PartsStudy, TrackingStudy):
    """Accuracy of the tracker, consistency of its covariance, and the whole pipeline beside baselines."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "accuracy": Part(_accuracy, table=_accuracy_table),
        "consistency": Part(_consistency, table=consistency.table),
        "pipeline": Part(_pipeline, pipeline.chart),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_consistency": 1, "n_approaches": 1}

    n: int = 20  # recordings of each object for the accuracy, their motions by turns
    seconds: float = 5.0  # length of the recordings, approaches at a given speed apart
    n_consistency: int = 4  # recordings of each kind for the consistency
    n_approaches: int = 4  # approaches of each object for the pipeline
