"""A recording to a 3D path: `pps_vision.track`, on which `pps-vision track` is built."""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pps_vision.app.budget import Choice, cheapest, configurations
from pps_vision.app.device import torch_device
from pps_vision.app.diagnosis import Diagnosis, diagnose
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.errors import InputError
from pps_vision.recordings.exchange import TrackedPair
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.problems import count_by_kind
from pps_vision.recordings.recording import Recording
from pps_vision.types import Array, Status, StereoFrame, Track3D, Truth
from tracking import DEFAULT_ORDER, FollowedBy, Mode
from tracking.acquisition import SearchCounts, Stages
from tracking.camera_pose import CameraMotion
from tracking.kalman import KalmanParams
from tracking.smoother import smoothed_steps
from tracking.tracker import Tracker, TrackerParams, TrackerStep

_WARM_UP = 10  # frames a tracker is given before its errors count
_TRUTH_WITHIN_S = 0.02  # of a track's stamp
_BATCH = 16  # stereo pairs that are processed together on a device


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
        choice: Choice | None = None,
    ) -> None:
        self.recording, self.params, self.seed, self.device, self.choice = recording, params, seed, device, choice
        self.stopwatch = Stopwatch()
        self._search_counts: SearchCounts = Counter()
        self._cameras = _CameraNumbers()
        self._followed_by = Counter[FollowedBy]()

    def __len__(self) -> int:
        return len(self.recording)

    def __iter__(self) -> Iterator[TrackerStep]:
        return (step for _, _, step in self.numbered())

    def numbered(self, warn: Callable[[str], None] = lambda _: None) -> Iterator[tuple[int, StereoFrame, TrackerStep]]:
        """Yield the number of each frame (as `Recording.numbered`), the frame, and what tracking it gave.

        `warn` is given a line once cameras that are declared fixed are seen to move.
        """
        self.stopwatch.ms.clear()
        tracker = tracker_for(self.recording, self.params, self.seed, self.stopwatch)
        self._search_counts, self._cameras = tracker.search_counts, _CameraNumbers(warn)
        self._followed_by = Counter()
        for number, frame, step in self._tracked(tracker):
            if step.followed_by and step.track.is_known:
                self._followed_by[step.followed_by] += 1
            yield number, frame, step

    def _tracked(self, tracker: Tracker) -> Iterator[tuple[int, StereoFrame, TrackerStep]]:
        """As `numbered`."""
        if self.device is None:
            for number, frame in self.recording.numbered():
                with self.stopwatch("total"):
                    step = tracker.step(frame)
                self._cameras.add(tracker.camera_motion, step.track.stamp_s)
                yield number, frame, step
            return
        from tracking.batch import BatchTracker  # loads torch and kornia, which takes seconds

        batches = BatchTracker(tracker, torch_device(self.device))
        for chunk in chunks(self.recording.numbered(), _BATCH):
            with self.stopwatch("total", len(chunk)):
                steps = batches.steps([frame for _, frame in chunk])
            self._cameras.add(tracker.camera_motion, steps[-1].track.stamp_s)
            yield from ((number, frame, step) for (number, frame), step in zip(chunk, steps, strict=True))

    def path(self, steps: Iterable[TrackerStep], smooth: bool) -> Iterator[TrackerStep]:
        """Yield `steps`; with `smooth` they come later, their tracks corrected by later measurements (RTS smoothing).

        Raises:
            InputError: There is no step: no stereo pair was readable.
        """
        step = None
        for step in smoothed_steps(self.params.motion_model, steps) if smooth else steps:
            yield step
        if step is None:
            raise InputError(self.recording.name, "no usable frame; expected at least one readable stereo pair")

    def tracked_pairs(self, steps: Iterable[TrackerStep]) -> Iterator[TrackedPair]:
        """Yield what the writers take of each step."""
        pairs = iter(self.recording.pairs)
        for step in steps:
            stamp_s = step.track.stamp_s
            left, right = next(pair for pair in pairs if 0.5 * (pair[0].stamp_s + pair[1].stamp_s) == stamp_s)
            residual_px = step.observation.residual_px if step.observation else np.nan
            yield TrackedPair((left.path, right.path), step.track, step.detections, residual_px)

    def diagnosis(self, path: "PathNumbers") -> Diagnosis | None:
        """Why hardly anything was tracked or positions are wrong, and what to try; None where neither is so."""
        cameras = self._cameras.summary()
        turn, share = (cameras["rotation_deg"], cameras["rotation_deg_s"]), path.tracked_share
        return diagnose(self.recording, self.params.mode, self._search_counts, share, turn, path.residual_px)

    def summary(self, path: "PathNumbers", diagnosis: Diagnosis | None = None) -> dict[str, object]:
        """What was tracked and how, for summary.json."""
        summary: dict[str, object] = {
            "source": self.recording.name,
            "mode": self.params.mode,
            "model": "flight" if self.params.flight else "kalman",
            "reduction": self.params.reduction,
            "device": self.device,
            "seed": self.seed,
            "pairs": len(self),
            "frames": path.frames,
            "status": {status.value: path.status[status] for status in Status},
            "followed_by": dict(self._followed_by),
            "ms_per_pair": self.stopwatch.summary(),
            "cameras": self._cameras.summary(),
            "skipped": count_by_kind(self.recording.problems),
            "warnings": self.recording.warnings,
        }
        if path.tracked_share:
            summary["object"] = path.diameter()
            summary["residual_px"] = path.residual_px
        if self.choice:
            summary["max_error"] = self.choice.summary()
        if diagnosis:
            summary["diagnosis"] = asdict(diagnosis)
        if self.recording.truth:
            summary["errors"] = path.errors()
        return summary

    def headline(self, path: "PathNumbers") -> str:
        """The same in one line for the terminal."""
        tracked = path.status[Status.TRACKING]
        line = f"{tracked} of {path.frames} pairs tracked, median {np.median(self.stopwatch.ms['total']):.1f} ms a pair"
        if self.recording.truth:
            errors = path.errors()
            rms_mm, all_mm = errors["position_rms_mm"], errors["position_rms_all_mm"]
            if np.isfinite(all_mm):
                line += f", 3D RMS {rms_mm:.2f} mm where tracked, {all_mm:.2f} mm with predicted positions"
        if tracked:
            size = {key: f"{1000 * value:.3g}" for key, value in path.diameter().items()}
            line += f", object {size['diameter_m']} mm across (95 %: {size['low_95_m']}–{size['high_95_m']})"
        skipped = self.recording.skipped
        return line + (f", {skipped} problems skipped" if skipped else "")

    def arrays(self, smooth: bool = False) -> TrackArrays:
        """Track the recording and return its path as arrays; `smooth` as in `path`."""
        n = len(self)
        numbers, covs, statuses = np.empty((n, 8)), np.empty((n, 6, 6)), list[str]()
        for k, step in enumerate(self.path(self, smooth)):
            track = step.track
            numbers[k] = (track.stamp_s, *track.position, *track.velocity, track.radius_m)
            covs[k] = track.cov[:6, :6]
            statuses.append(track.status.value)
        stamps_s, position, velocity, radius_m = np.split(numbers[: len(statuses)], (1, 4, 7), axis=1)
        cov = covs[: len(statuses)]
        return TrackArrays(stamps_s[:, 0], position, velocity, cov, radius_m[:, 0], np.array(statuses))


class _CameraNumbers:
    """Largest errors of the cameras' nominal poses over a recording."""

    def __init__(self, warn: Callable[[str], None] = lambda _: None) -> None:
        self._warn = warn
        self._rotation_rad, self._rate_rad_s = 0.0, 0.0
        self._last: CameraMotion | None = None

    def add(self, motion: CameraMotion, stamp_s: float) -> None:
        """Take the next frame's; the first one with a rotation is warned of."""
        if motion.rotation_rad.any() and not self._rotation_rad:
            self._warn(
                f"the cameras move although declared fixed, at {stamp_s:.2f} s; only their rotation is compensated"
            )
        self._rotation_rad = max(self._rotation_rad, float(np.linalg.norm(motion.rotation_rad)))
        self._rate_rad_s = max(self._rate_rad_s, motion.rate_rad_s)
        self._last = motion

    def summary(self) -> dict[str, float]:
        """Largest rotation of a rig that is said to be fixed, and rate; delay of the joints at the end, and its
        standard deviation."""
        return {
            "rotation_deg": float(np.rad2deg(self._rotation_rad)),
            "rotation_deg_s": float(np.rad2deg(self._rate_rad_s)),
            "joint_delay_ms": 1000 * self._last.delay_s if self._last else np.nan,
            "joint_delay_std_ms": 1000 * self._last.delay_std_s if self._last else np.nan,
        }


class PathNumbers:
    """Counts and errors of a path, and the object's size; `add` takes its tracks one by one and keeps 40 bytes of each.

    Attributes:
        frames: How many there were.
        status: How many there were of each status.
    """

    def __init__(self, truth: Sequence[Truth] = ()) -> None:
        self.frames, self.status = 0, Counter[Status]()
        self._truth = sorted(truth, key=lambda row: row.stamp_s)
        self._stamps = np.array([row.stamp_s for row in self._truth])
        self._tracked, self._predicted = array("d"), array("d")  # errors of position and velocity in turn
        self._radii = array("d")  # radius and its standard deviation in turn, where tracked
        self._residuals_px = array("d")

    @property
    def tracked_share(self) -> float:
        """Share with the status tracking."""
        return self.status[Status.TRACKING] / max(1, self.frames)

    @property
    def residual_px(self) -> float:
        """Median RMS reprojection error of the pairs that measured the position; NaN without any."""
        return float(np.median(self._residuals_px)) if self._residuals_px else np.nan

    def add(self, track: Track3D, residual_px: float = np.nan) -> None:
        """Take the next track, and the RMS reprojection error of its pair (NaN: not measured)."""
        self.frames += 1
        self.status[track.status] += 1
        if track.status == Status.TRACKING:
            self._radii.extend((track.radius_m, track.radius_var_m2**0.5))
        if np.isfinite(residual_px):
            self._residuals_px.append(residual_px)
        if not self._truth or self.frames <= _WARM_UP or not track.is_known:
            return
        after = int(np.searchsorted(self._stamps, track.stamp_s))
        near = self._truth[max(0, after - 1) : after + 1]
        row = min(near, key=lambda row: abs(row.stamp_s - track.stamp_s))
        if abs(row.stamp_s - track.stamp_s) < _TRUTH_WITHIN_S:
            at = row.position + row.velocity * (track.stamp_s - row.stamp_s)
            errors = self._tracked if track.status == Status.TRACKING else self._predicted
            both = track.position - at, track.velocity - row.velocity
            errors.extend(float(np.linalg.norm(error)) for error in both)

    def diameter(self) -> dict[str, float]:
        """Median diameter of the object where it is tracked, and its 95 % interval, m.

        The errors of a size have their cause in common (the outline, the calibration): a median's is that of one.
        """
        radius_m, std_m = np.median(np.reshape(self._radii, (-1, 2)), axis=0)
        low_m, high_m = max(radius_m - 1.96 * std_m, 0.0), radius_m + 1.96 * std_m
        return {"diameter_m": 2 * float(radius_m), "low_95_m": 2 * float(low_m), "high_95_m": 2 * float(high_m)}

    def errors(self) -> dict[str, float]:
        """Share tracked, RMS and median error of the position, RMS error of the velocity, after the first ten frames.

        The errors are of the frames with status tracking; `position_rms_all_mm` is of all frames with a position,
        predicted ones (coasting) included.
        """
        tracked, predicted = (np.reshape(errors, (-1, 2)) for errors in (self._tracked, self._predicted))
        later = self.frames - _WARM_UP
        return {
            "tracked_share": len(tracked) / later if later > 0 else np.nan,
            "position_rms_mm": 1000 * _rms(tracked[:, 0]),
            "position_rms_all_mm": 1000 * _rms(np.concatenate([tracked[:, 0], predicted[:, 0]])),
            "position_median_mm": 1000 * float(np.median(tracked[:, 0])) if len(tracked) else np.nan,
            "velocity_rms_m_s": _rms(tracked[:, 1]),
        }


def track(
    recording: Recording | Path | str,
    mode: Mode = "generic",
    order: int = DEFAULT_ORDER,
    *,
    reduction: int = 1,
    params: TrackerParams | None = None,
    max_error_mm: float | None = None,
    device: str | None = None,
    seed: int = 0,
) -> TrackedRecording:
    """Track the moving object of a recording in 3D.

    `for step in track(recording)` gives one `TrackerStep` for each stereo pair as it is tracked;
    `track(recording).arrays()` gives the whole path as arrays.

    Args:
        recording: A recording, or the folder of an iCub's recording.
        mode: "generic" tracks whatever moves, "marker" a green marker.
        order: Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk.
        reduction: Average each block of so many pixels a side to one before looking.
        params: All parameters of the tracker, instead of `mode`, `order` and `reduction`.
        max_error_mm: Choose the fastest configuration whose 3D RMS error is expected to be below this, instead of
            `mode`, `order` and `reduction`.
        device: Process batches of frames with torch on this device (cpu, cuda, cuda:1); None: frame by frame, without
            torch.
        seed: Seed of the particles.

    Raises:
        InputError: The recording cannot be read or has no calibration, or options contradict each other.
    """
    if not isinstance(recording, Recording):
        recording = open_recording(recording)
    params = params or TrackerParams(mode, reduction, kalman=KalmanParams.of_order(order))
    if max_error_mm is not None and params != TrackerParams():
        raise InputError("track", "max_error_mm chooses mode, order, model and reduction itself; expected none of them")
    if max_error_mm is None:
        return TrackedRecording(recording, params, seed, device)
    tried = configurations(recording.rig.left.width if recording.rig else 0)
    choice = cheapest(recording, max_error_mm, lambda params: tracker_for(recording, params, seed), tried)
    return TrackedRecording(recording, choice.configuration.params, seed, device, choice)


def tracker_for(recording: Recording, params: TrackerParams, seed: int, stages: Stages | None = None) -> Tracker:
    """Return a tracker for the recording's cameras; on a robot its own body is no stimulus.

    Raises:
        InputError: The recording has no calibration.
    """
    rig = recording.calibrated()
    own_body = None
    if recording.robot:
        from pps_vision.robot.silhouette import Silhouette  # loads the kinematics

        own_body = Silhouette(recording.robot)
    timed = {} if stages is None else {"stages": stages}
    return Tracker(params, rig, np.random.default_rng(seed), own_body, **timed)


def errors_against(truth: Sequence[Truth], tracks: Iterable[Track3D]) -> dict[str, float]:
    """Return the errors of tracks, as `PathNumbers.errors`."""
    path = PathNumbers(truth)
    for track in tracks:
        path.add(track)
    return path.errors()


T = TypeVar("T")


def chunks(items: Iterable[T], size: int) -> Iterator[list[T]]:
    """All items in order, `size` at a time (the last may be shorter)."""
    source = iter(items)
    while chunk := list(islice(source, size)):
        yield chunk


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
