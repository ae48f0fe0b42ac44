"""Run trackers on recordings and judge their tracks against the truth."""

from collections.abc import Sequence

import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import FilteredPipeline, StereoPipelineName, stereo_pipeline
from pps_vision.experiments.scenarios import EYES_M, Footage, tracker_params
from pps_vision.experiments.study import Method, Metric, Values, mean, percent, rms
from pps_vision.experiments.timing import timed_steps
from pps_vision.types import Array, Track3D
from tracking.tracker import Tracker, TrackerStep

NEAR = 1 / 6
"""Share of its distance within which a track is near the object."""
SETTLE_S = 0.5
"""Time that a tracker has to find what comes into sight."""
METRICS = {
    "near_percent": Metric("near", percent),
    "rms_mm": Metric("error_mm", rms),
    "worst_recording_mm": Metric("recording_rms_mm", lambda values: float(np.max(values)) if len(values) else np.nan),
    "mean_recording_mm": Metric("recording_rms_mm", mean),
    "false_percent": Metric("false", percent),
}


def steps_of(recording: Footage, seed: int, mode: str | None = None) -> tuple[list[TrackerStep], list[float]]:
    """Return our tracker's steps on all frames, nothing given, and their processor times (ms)."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(tracker_params(recording, mode), recording.rig, rng, own_body=recording.own_body)
    return timed_steps(tracker.step, recording.frames)


def tracker(mode: str | None = None) -> Method:
    """Our tracker as a study's method, in the mode for the recording's object or in the given one."""

    def run(recording: Footage, seed: int) -> Values:
        steps, ms = steps_of(recording, seed, mode)
        return judge(recording, [step.track for step in steps]) | {"ms": ms}

    return run


def baseline_tracks(recording: Footage, name: StereoPipelineName) -> tuple[list[Track3D], list[float]]:
    """Return a baseline's tracks on all frames, the true boxes given in the first that shows the object, and ms."""
    first, boxes = recording.first_boxes
    pipeline = FilteredPipeline(stereo_pipeline(name, recording.rig), recording.rig)
    known = [Track3D.unknown(frame.stamp_s) for frame in recording.frames[:first]]
    known.append(pipeline.start(recording.frames[first], boxes))
    tracks, ms = timed_steps(pipeline.step, recording.frames[first + 1 :])
    return known + tracks, ms


def baseline(name: StereoPipelineName) -> Method:
    """A baseline's pipeline as a study's method."""

    def run(recording: Footage, seed: int) -> Values:
        tracks, ms = baseline_tracks(recording, name)
        return judge(recording, tracks) | {"ms": ms}

    return run


def judge(recording: Footage, tracks: Sequence[Track3D]) -> dict[str, Array]:
    """Return the values that `METRICS` summarizes.

    Over the frames that count: whether the track is near the object (within a sixth of its distance from the eyes),
    and the error of the known tracks. Over all frames from the first of these on: whether the track is false, that is,
    not near and farther off than three of its own standard deviations. Of two equally good objects the one followed
    first counts.
    """
    counts = recording.judged(SETTLE_S)
    known = np.array([track.is_known for track in tracks])
    path = np.array([track.position for track in tracks])
    truth = recording.position
    if recording.other_position is not None and known.any():
        k = int(np.argmax(known))
        both = (truth, recording.other_position)
        truth = min(both, key=lambda one: float(np.linalg.norm(one[k] - path[k])))
    error = np.linalg.norm(path - truth, axis=1)
    near = known & (error <= NEAR * np.linalg.norm(truth - EYES_M, axis=1))
    std = [np.sqrt(np.linalg.eigvalsh(t.cov[:3, :3])[-1]) if t.is_known else np.nan for t in tracks]
    after = np.arange(len(tracks)) >= (int(np.argmax(counts)) if counts.any() else 0)
    counted = 1000 * error[counts & known]
    return {
        "near": near[counts],
        "error_mm": counted,
        "recording_rms_mm": np.array([rms(counted)]) if len(counted) else np.empty(0),
        "false": (known & ~near & (error > 3 * np.array(std)))[after],
    }
