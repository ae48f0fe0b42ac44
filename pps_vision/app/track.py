"""A recording to a 3D path: `pps_vision.track`, on which `pps-vision track` is built."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pps_vision.app.budget import Choice, cheapest
from pps_vision.app.device import torch_device
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Status, StereoFrame, Track3D, Truth
from tracking.acquisition import Stages
from tracking.kalman import KalmanParams
from tracking.names import DEFAULT_ORDER, Mode
from tracking.smoother import smoothed_tracks
from tracking.tracker import Tracker, TrackerParams, TrackerStep

_WARM_UP = 10  # frames a tracker is given before its errors count


@dataclass(frozen=True)
class TrackArrays:
    """The path of the object, one row for each of n stereo pairs; NaN where its position is unknown.

    Attributes:
        stamps_s: (n,) stamps of the pairs.
        position: (n, 3) m, root frame (the left camera's where the cameras are fixed).
        velocity: (n, 3) m/s.
        cov: (n, 6, 6) covariance of position and velocity.
        radius_m: (n,) radius of the object.
        status: (n,) "searching", "tracking", "coasting" or "lost".
    """

    stamps_s: Array
    position: Array
    velocity: Array
    cov: Array
    radius_m: Array
    status: NDArray[np.str_]


class TrackedRecording:
    """A recording and how it is tracked.  Iterating tracks it, one `TrackerStep` for each stereo pair.

    Every iteration starts with a new tracker and the same seed, so that it gives the same path.  `choice` says
    how the parameters were chosen where an error limit was given; `stopwatch` holds the times of the stages.
    """

    def __init__(
        self,
        recording: Recording,
        params: TrackerParams,
        seed: int = 0,
        device: str | None = None,
        batch: int = 16,
        choice: Choice | None = None,
    ) -> None:
        if batch < 1:
            raise InputError("track", f"batch {batch}; expected at least 1")
        self.recording, self.params, self.seed, self.choice = recording, params, seed, choice
        self._device, self._batch = device, batch
        self.stopwatch = Stopwatch()

    def __len__(self) -> int:
        return len(self.recording)

    def __iter__(self) -> Iterator[TrackerStep]:
        return (step for _, _, step in self.numbered())

    def numbered(self) -> Iterator[tuple[int, StereoFrame, TrackerStep]]:
        """Yield the number of each frame (as `Recording.numbered`), the frame, and what tracking it gave."""
        self.stopwatch.ms.clear()
        tracker = tracker_for(self.recording, self.params, self.seed, self.stopwatch)
        if self._device is None:
            for number, frame in self.recording.numbered():
                with self.stopwatch("total"):
                    step = tracker.step(frame)
                yield number, frame, step
            return
        from tracking.batch import BatchTracker  # loads torch and kornia, which takes seconds

        batches = BatchTracker(tracker, torch_device(self._device))
        for chunk in chunks(self.recording.numbered(), self._batch):
            with self.stopwatch("total", len(chunk)):
                steps = batches.steps([frame for _, frame in chunk])
            yield from ((number, frame, step) for (number, frame), step in zip(chunk, steps, strict=True))

    def path(self, steps: Iterable[TrackerStep], smooth: bool = False) -> list[Track3D]:
        """Return the tracks of `steps`; with `smooth` later measurements correct earlier tracks (RTS smoothing).

        Raises:
            InputError: There is no step: no stereo pair was readable.
        """
        steps = list(steps)
        if not steps:
            raise InputError(self.recording.name, "no usable frame; expected at least one readable stereo pair")
        return smoothed_tracks(self.params.kalman, steps) if smooth else [step.track for step in steps]

    def arrays(self, smooth: bool = False) -> TrackArrays:
        """Track the recording and return its path as arrays; `smooth` as in `path`."""
        tracks = self.path(self, smooth)
        return TrackArrays(
            np.array([track.stamp_s for track in tracks]),
            np.array([track.position for track in tracks]),
            np.array([track.velocity for track in tracks]),
            np.array([track.cov[:6, :6] for track in tracks]),
            np.array([track.radius_m for track in tracks]),
            np.array([track.status.value for track in tracks]),
        )


def track(
    recording: Recording | Path | str,
    mode: Mode = "generic",
    order: int = DEFAULT_ORDER,
    *,
    params: TrackerParams | None = None,
    max_error_mm: float | None = None,
    device: str | None = None,
    batch: int = 16,
    seed: int = 0,
) -> TrackedRecording:
    """Track the moving object of a recording in 3D.

    `for step in track(recording)` gives one `TrackerStep` for each stereo pair as it is tracked;
    `track(recording).arrays()` gives the whole path as arrays.

    Args:
        recording: A recording, or the folder of an iCub's recording.
        mode: "generic" tracks whatever moves, "marker" a green marker.
        order: Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk.
        params: All parameters of the tracker, instead of `mode` and `order`.
        max_error_mm: Choose the fastest configuration whose 3D RMS error is expected to be below this, instead of
            `mode` and `order`.
        device: Process batches of frames with torch on this device (cpu, cuda, cuda:1); None: frame by frame, without
            torch.
        batch: Stereo pairs in a batch of `device`.
        seed: Seed of the particles.

    Raises:
        InputError: The recording cannot be read or has no calibration, or options contradict each other.
    """
    if not isinstance(recording, Recording):
        recording = open_recording(recording)
    params = params or TrackerParams(mode=mode, kalman=KalmanParams.of_order(order))
    if max_error_mm is not None and params != TrackerParams():
        raise InputError("track", "max_error_mm chooses mode and order itself; expected no mode, no order")
    if max_error_mm is None:
        return TrackedRecording(recording, params, seed, device, batch)
    choice = cheapest(recording, max_error_mm, lambda tried: tracker_for(recording, tried, seed))
    return TrackedRecording(recording, choice.configuration.params, seed, device, batch, choice)


def tracker_for(recording: Recording, params: TrackerParams, seed: int, stages: Stages | None = None) -> Tracker:
    """Return a tracker for the recording's cameras; on a robot its own body is no stimulus.

    Raises:
        InputError: The recording has no calibration.
    """
    if recording.rig is None:
        raise InputError(recording.name, "holds no icubEyes.ini; expected a calibration there or by --calib")
    own_body = Silhouette(recording.robot) if recording.robot else None
    timed = {} if stages is None else {"stages": stages}
    return Tracker(params, recording.rig, np.random.default_rng(seed), own_body, **timed)


def errors_against(truth: tuple[Truth, ...], tracks: list[Track3D]) -> dict[str, float]:
    """How far the path is from the truth, after the first ten frames: share tracked, 3D RMS, median, velocity RMS."""
    stamps = np.array([row.stamp_s for row in truth])
    position, velocity = [], []
    later = tracks[_WARM_UP:]
    for track in later:
        row = truth[int(np.argmin(np.abs(stamps - track.stamp_s)))]
        if track.status == Status.TRACKING and abs(row.stamp_s - track.stamp_s) < 0.02:
            at = row.position + row.velocity * (track.stamp_s - row.stamp_s)
            position.append(np.linalg.norm(track.position - at))
            velocity.append(np.linalg.norm(track.velocity - row.velocity))
    error, slip = np.array(position), np.array(velocity)
    return {
        "tracked_share": len(error) / len(later) if later else np.nan,
        "position_rms_mm": 1000 * _rms(error),
        "position_median_mm": 1000 * float(np.median(error)) if len(error) else np.nan,
        "velocity_rms_m_s": _rms(slip),
    }


T = TypeVar("T")


def chunks(items: Iterable[T], size: int) -> Iterator[list[T]]:
    """All items in order, `size` at a time (the last may be shorter)."""
    source = iter(items)
    while chunk := list(islice(source, size)):
        yield chunk


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
