"""Figures of `evaluate`: errors of several paths or boxes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.evaluate import Path3D, Score, errors_of
from pps_vision.app.evaluate_boxes import DISTANCES_PX, OVERLAPS, Boxes, per_frame, precision, success


def path_errors(paths: Sequence[Path3D], truth: Path3D, scores: Sequence[Score], align: bool) -> Figure:
    """Distance to the truth over time, and the share of positions within a distance."""
    figure = Figure(figsize=(11, 4), layout="constrained")
    over_time, share = figure.subplots(1, 2, width_ratios=(2, 1))
    for path, score in zip(paths, scores, strict=True):
        stamps, error, _ = errors_of(replace(path, stamps_s=path.stamps_s - score.lag_s), truth, align)
        distance_mm = 1000 * np.linalg.norm(error, axis=1)
        name = f"{path.name}: RMSE {score.rmse_mm:.2f} mm"
        over_time.plot(stamps - truth.stamps_s[0], distance_mm, ".-", ms=3, lw=0.8, label=name)
        share.plot(np.sort(distance_mm), np.arange(1, len(distance_mm) + 1) / len(distance_mm))
    over_time.set(xlabel="time (s)", ylabel="3D error (mm)", ylim=(0, None))
    share.set(xlabel="3D error (mm)", ylabel="share of positions", ylim=(0, 1), xlim=(0, None))
    over_time.legend(fontsize=7)
    for axis in (over_time, share):
        axis.grid(alpha=0.25)
    return figure


def box_curves(tracks: Sequence[Boxes], truth: Boxes) -> Figure:
    """Success and precision curves (Wu et al. 2013)."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    of_overlap, of_distance = figure.subplots(1, 2, sharey=True)
    for boxes in tracks:
        iou, distance_px = per_frame(boxes, truth)
        of_overlap.plot(OVERLAPS, success(iou), label=f"{boxes.name}: area {np.mean(success(iou)):.3f}")
        within = precision(distance_px)
        of_distance.plot(DISTANCES_PX, within, label=f"{boxes.name}: {within[20]:.3f} at 20 px")
    of_overlap.set(xlabel="overlap threshold", ylabel="share of frames above it (success)", ylim=(0, 1), xlim=(0, 1))
    of_distance.set(xlabel="distance of the centres (px)", ylabel="share of frames within it (precision)", xlim=(0, 50))
    for axis in (of_overlap, of_distance):
        axis.grid(alpha=0.25)
        axis.legend(fontsize=7)
    return figure
