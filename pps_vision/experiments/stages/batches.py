"""The tracker frame by frame and in batches on a torch device (`track --device`): time against the detections' error.

A marker and a ball, on one processor thread and on a CUDA device where there is one.
"""

from functools import partial
from time import perf_counter, process_time
from typing import Any

import numpy as np
import torch

from pps_vision.app.track import chunks, torch_device
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.recordings import Footage, moving, tracker_params
from pps_vision.experiments.study import TURNS, Method, Metric, Values, compare, rms
from pps_vision.types import Array
from tracking.batch import BatchTracker
from tracking.tracker import Tracker, TrackerStep

SIZES = (1, 4, 16, 64)
ALONE = "frame by frame"
_METRICS = {"error_px": Metric("error_px", rms)}
Pairs = tuple[Footage, Array]  # a recording and the true centres (n, 2, 2) px
chart = cells_chart("error_px", "RMS error of detections (px)", default=ALONE)


def run(study: Any) -> dict[str, Any]:
    """Return by object and way: time of a pair and pixel error."""
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    methods: dict[str, Method] = {ALONE: partial(_run, "", 1)}
    for device in devices:
        methods |= {f"{device}, {size} pairs": partial(_run, device, size) for size in SIZES}
    scenarios = {stimulus: partial(_pairs, stimulus, study.seconds) for stimulus in ("marker", "ball")}
    for make in scenarios.values():  # loads and compiles the code of each way
        pairs = make(study.seed)
        for method in methods.values():
            method(pairs, study.seed)
    return {"devices": devices, "cells": compare(scenarios, methods, _METRICS, study.seeds, ALONE, TURNS)}


def _pairs(stimulus: str, seconds: float, seed: int) -> Pairs:
    recording = moving(stimulus, "circle", seed, seconds)
    views = [recording.rig.view_of(frame) for frame in recording.frames]
    positions = zip(views, recording.position, strict=True)
    truth = np.array([[view.left.project(p), view.right.project(p)] for view, p in positions])
    return recording, truth


def _run(device: str, size: int, pairs: Pairs, seed: int) -> Values:
    clock = perf_counter if device == "cuda" else process_time  # a device's work is no processor time
    start = clock()
    recording, truth = pairs
    steps = _steps(device, size, recording, seed)
    ms = 1000 * (clock() - start) / len(steps)
    centers = np.full(truth.shape, np.nan)
    for k, step in enumerate(steps):
        for detection in step.detections:
            centers[k, ("left", "right").index(detection.camera)] = detection.center_px
    error = np.linalg.norm(centers - truth, axis=-1)
    return {"ms": [ms], "error_px": error[np.isfinite(error)]}


def _steps(device: str, size: int, recording: Footage, seed: int) -> list[TrackerStep]:
    """Frame by frame without a device."""
    tracker = Tracker(tracker_params(recording), recording.rig, np.random.default_rng(seed))
    if not device:
        return [tracker.step(frame) for frame in recording.frames]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        batches = BatchTracker(tracker, torch_device(device))
        return [step for chunk in chunks(recording.frames, size) for step in batches.steps(chunk)]
    finally:
        torch.set_num_threads(threads)
