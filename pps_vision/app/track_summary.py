"""Summary of a tracked recording: summary.json, one line for the terminal, and the diagnosis of a failure."""

from dataclasses import asdict

import numpy as np

from pps_vision.app.diagnosis import Diagnosis, diagnose
from pps_vision.app.track import TrackedRecording
from pps_vision.app.track_statistics import PathStatistics
from pps_vision.recordings.warnings import count_by_kind
from pps_vision.types import Status


def diagnosis_of(run: TrackedRecording, path: PathStatistics) -> Diagnosis | None:
    """Return why hardly anything was tracked or positions are wrong, and what to try; None if neither is the case."""
    rotation = (run.cameras.rotation_deg, run.cameras.rotation_deg_s)
    return diagnose(run.recording, run.params.mode, run.search_counts, path.tracked_share, rotation, path.residual_px)


def summary(run: TrackedRecording, path: PathStatistics, diagnosis: Diagnosis | None = None) -> dict[str, object]:
    """Return the settings and results of tracking, for summary.json."""
    content: dict[str, object] = {
        "source": run.recording.name,
        "mode": run.params.mode,
        "reduction": run.params.reduction,
        "device": run.device,
        "seed": run.seed,
        "pairs": len(run),
        "frames": path.frames,
        "status": {status.value: path.status[status] for status in Status},
        "followed_by": dict(run.followed_by),
        "ms_per_pair": run.stopwatch.summary(),
        "cameras": run.cameras.summary(),
        "skipped": count_by_kind(run.recording.problems),
        "warnings": run.recording.warnings,
    }
    if path.tracked_share:
        content["object"] = path.diameter()
        content["residual_px"] = path.residual_px
    if diagnosis:
        content["diagnosis"] = asdict(diagnosis)
    if run.recording.truth:
        content["errors"] = path.errors()
    return content


def headline(run: TrackedRecording, path: PathStatistics) -> str:
    """Return the main results in one line for the terminal."""
    n_tracked = path.status[Status.TRACKING]
    median_ms = np.median(run.stopwatch.ms["total"])
    parts = [f"{n_tracked} of {path.frames} pairs tracked", f"median {median_ms:.1f} ms a pair"]
    if run.recording.truth:
        errors = path.errors()
        rms_mm = errors["position_rms_mm"]
        rms_all_mm = errors["position_rms_all_mm"]
        if np.isfinite(rms_all_mm):
            parts += [f"3D RMS {rms_mm:.2f} mm where tracked", f"{rms_all_mm:.2f} mm with predicted positions"]
    if n_tracked:
        size_mm = {name: f"{1000 * value:.3g}" for name, value in path.diameter().items()}
        interval = f"{size_mm['low_95_m']}–{size_mm['high_95_m']}"
        parts.append(f"object {size_mm['diameter_m']} mm across (95 %: {interval})")
    if run.recording.skipped:
        parts.append(f"{run.recording.skipped} problems skipped")
    return ", ".join(parts)
