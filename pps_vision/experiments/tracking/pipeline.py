"""The whole pipeline, from stereo pairs to a track and a time to contact: ours beside OpenCV's trackers and SGBM."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.baselines.stereo_pipelines import StereoPipelineName
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.experiments.films.score import METRICS, baseline_tracks, judge, steps_of
from pps_vision.experiments.study import TURNS, Metric, SceneSource, Values, compare, median
from pps_vision.types import Array, Track3D

OURS = {"ours, generic": "generic", "ours, marker": "marker"}
BASELINES: tuple[StereoPipelineName, ...] = get_args(StereoPipelineName)
GOAL_MS = {"ours, generic": 4.5, "ours, marker": 0.8}  # largest median time of a pair with the object of `MEANT_FOR`
MEANT_FOR = {"ball": "ours, generic", "marker": "ours, marker"}  # our pipeline for each object
_SPEEDS_M_S = (0.05, 0.30)
_FARTHEST_M = 0.30  # largest distance from the start of an approach to its end
_LAST_S = (0.04, 0.5)  # before the touch, where the time to contact counts
_METRICS = {
    "rms_mm": METRICS["rms_mm"],
    "near_percent": METRICS["near_percent"],
    "ttc_percent": Metric("ttc_percent", median),
}


def compare_pipelines(
    scenarios: Callable[[Callable[..., Footage], Sequence[str]], dict[str, Callable[..., Any]]], seed: int, n: int
) -> dict[str, Any]:
    """Run all pipelines on balls and markers that approach the skin at 5–30 cm/s while the head moves.

    Baselines get the true boxes of the first frame and our filter. Returns by scenes and pipeline the 3D RMS error, the
    error of the time to contact, and the processor time with its ratio to CSRT.

    Args:
        scenarios: `TrackingStudy.scenarios`.
        seed: Seed of the first recording.
        n: Recordings of each object, their speeds from the slowest to the fastest.
    """
    speeds = np.geomspace(*_SPEEDS_M_S, n) if n > 1 else np.array([0.15])

    def film(stimulus: str, source: SceneSource, film_seed: int) -> Footage:
        speed = float(speeds[film_seed - seed])
        return moving(stimulus, "approach", film_seed, _FARTHEST_M / speed + 0.1, source, speed=speed)

    methods = {name: partial(_ours, mode) for name, mode in OURS.items()}
    methods |= {name: partial(_baseline, name) for name in BASELINES}
    seeds = range(seed, seed + n)
    return {"cells": compare(scenarios(film, ("ball", "marker")), methods, _METRICS, seeds, "two CSRT", TURNS)}


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw time against 3D error, one panel for each kind of scene."""
    return speed_errors(numbers["cells"], "rms_mm", "3D RMS error (mm)", BASELINES, "ours, generic")


def _ours(mode: str, recording: Footage, seed: int) -> Values:
    steps, ms = steps_of(recording, seed, mode)
    return _values(recording, [step.track for step in steps], ms)


def _baseline(name: StereoPipelineName, recording: Footage, seed: int) -> Values:
    return _values(recording, *baseline_tracks(recording, name))


def _values(recording: Footage, tracks: list[Track3D], ms: list[float]) -> Values:
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
