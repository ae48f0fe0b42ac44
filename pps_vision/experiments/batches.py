"""The tracker frame by frame and in batches on a torch device: time a pair against the size of the batch."""

from dataclasses import dataclass
from functools import partial
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
import torch
from matplotlib.figure import Figure

from pps_vision.app.device import torch_device
from pps_vision.app.track import chunks
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.films.recordings import Footage, moving, tracker_params
from pps_vision.experiments.study import TURNS, Method, Metric, SampledStudy, Values, compare, mean, rms
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array
from tracking.batch import BatchTracker
from tracking.tracker import Tracker, TrackerStep

SIZES = (1, 4, 16, 64)
ALONE = "frame by frame"
_METRICS = {
    "error_px": Metric("error_px", rms),
    "apart_px": Metric("apart_px", lambda values: float(np.max(values)) if len(values) else np.nan),
    "only_in_one": Metric("only_in_one", mean),
}


class Pairs(NamedTuple):
    """A recording, the true centres (n, 2, 2) px, and the centres that the tracker detects frame by frame."""

    recording: Footage
    truth: Array
    alone: Array


@dataclass(frozen=True)
class Batches(SampledStudy):
    """A marker and a ball tracked frame by frame and by `track --device`: time a pair against the size of the batch, on
    one processor thread and on a CUDA device where there is one, and how far the detections are apart."""

    seconds: float = 2.6
    """Length of each, 20 pairs a second."""

    def run(self) -> dict[str, Any]:
        """Return by object and way: time a pair, pixel error, largest distance from the detections frame by frame."""
        devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
        methods: dict[str, Method] = {ALONE: partial(_run, "", 1)}
        for device in devices:
            methods |= {f"{device}, {size} pairs": partial(_run, device, size) for size in SIZES}
        scenarios = {stimulus: partial(self._pairs, stimulus) for stimulus in ("marker", "ball")}
        for make in scenarios.values():  # loads and compiles what each way needs
            pairs = make(self.seed)
            for method in methods.values():
                method(pairs, self.seed)
        return {"devices": devices, "cells": compare(scenarios, methods, _METRICS, self.seeds, ALONE, TURNS)}

    def _pairs(self, stimulus: str, seed: int) -> Pairs:
        recording = moving(stimulus, "circle", seed, self.seconds)
        views = [recording.rig.view_of(frame) for frame in recording.frames]
        places = zip(views, recording.position, strict=True)
        truth = np.array([[view.left.project(p), view.right.project(p)] for view, p in places])
        return Pairs(recording, truth, centers(_steps("", 1, recording, seed)))

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time a pair against the pixel error, one panel an object."""
        return speed_errors(numbers["cells"], "error_px", "RMS error of detections (px)", (), ALONE)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the ratio of times to frame by frame, and the largest distance of detections."""
        cells = numbers["cells"]
        rows = []
        for way in next(iter(cells.values())):
            ratios = [estimate(cell[way]["ratio"], 2) for cell in cells.values()]
            rows.append([way, *ratios, *(estimate(cell[way]["apart_px"][:1], 2) for cell in cells.values())])
        header = ["way", *(f"time ratio, {name}" for name in cells), *(f"at most apart, {name} (px)" for name in cells)]
        return {"": Table(header, rows)}


def _run(device: str, size: int, pairs: Pairs, seed: int) -> Values:
    clock = perf_counter if device == "cuda" else process_time  # what a device does is no processor time
    begun = clock()
    steps = _steps(device, size, pairs.recording, seed)
    ms = 1000 * (clock() - begun) / len(steps)
    return {"ms": [ms], **differences(centers(steps), pairs.alone, pairs.truth)}


def differences(found: Array, alone: Array, truth: Array) -> dict[str, Array]:
    """Return distances (px) of detected centres (n, 2, 2) from the truth and from others, and which only one has."""
    error, apart = (np.linalg.norm(found - other, axis=-1).ravel() for other in (truth, alone))
    return {
        "error_px": error[np.isfinite(error)],
        "apart_px": apart[np.isfinite(apart)],
        "only_in_one": (np.isnan(found[..., 0]) != np.isnan(alone[..., 0])).ravel(),
    }


def _steps(device: str, size: int, recording: Footage, seed: int) -> list[TrackerStep]:
    """Frame by frame without a device."""
    tracker = Tracker(tracker_params(recording), recording.rig, np.random.default_rng(seed))
    if not device:
        return [tracker.step(frame) for frame in recording.frames]
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        batches = BatchTracker(tracker, torch_device(device))
        return [step for chunk in chunks(recording.frames, size) for step in batches.steps(chunk)]
    finally:
        torch.set_num_threads(before)


def centers(steps: list[TrackerStep]) -> Array:
    """Return (n, 2, 2) detected centres in the left and the right image, px; NaN where there is none."""
    found = np.full((len(steps), 2, 2), np.nan)
    for k, step in enumerate(steps):
        for one in step.detections:
            found[k, ("left", "right").index(one.camera)] = one.center_px
    return found
