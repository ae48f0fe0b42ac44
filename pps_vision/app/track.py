"""Track the objects in a recording: `pps_vision.track`, on which `pps-vision track` is built."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track_statistics import CameraStatistics
from pps_vision.errors import InputError, expect_kinds
from pps_vision.geometry.masks import BoxPx
from pps_vision.recordings.exchange import TrackedPair
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.types import Array, StereoFrame, Track3D
from tracking import DEFAULT_OBJECTS, DEFAULT_ORDER, FollowedBy, Mode
from tracking.acquisition import SearchCounts, Stages
from tracking.kalman import KalmanParams
from tracking.smoother import smoothed_steps
from tracking.tracker import Tracker, TrackerParams, TrackerStep

if TYPE_CHECKING:
    import torch

OBJECTS = range(1, 5)  # numbers of objects that can be followed at a time
_BATCH_PAIRS = 16  # processed together on a device
T = TypeVar("T")


@dataclass(frozen=True)
class TrackArrays:
    """Path of an object, one row for each of n stereo pairs; NaN where its position is unknown.

    Attributes:
        stamps_s: (n,) stamps of the pairs.
        position: (n, 3) m, root frame (the left camera's where the cameras are fixed).
        velocity: (n, 3) m/s.
        cov: (n, 6, 6) covariance of position and velocity.
        radius_m: (n,) radius of the object.
        status: (n,) "searching", "tracking", "coasting" or "lost".
        track_id: (n,) number of the track; the attended object may change.
    """

    stamps_s: Array
    position: Array
    velocity: Array
    cov: Array
    radius_m: Array
    status: NDArray[np.str_]
    track_id: NDArray[np.int_]


class TrackedRecording:
    """A recording with the parameters of its tracker.  Iterating yields one `TrackerStep` for each stereo pair.

    Every iteration starts with a new tracker and the same seed, so that it gives the same path.

    Attributes:
        stopwatch: Times of the stages in the last iteration.
        cameras: Errors of the cameras' nominal poses in the last iteration.
        search_counts: Results of the search for the object in the last iteration.
        followed_by: Number of pairs with a position by the cue that the object was followed by.
    """

    def __init__(self, recording: Recording, params: TrackerParams, seed: int = 0, device: str | None = None) -> None:
        self.recording = recording
        self.params = params
        self.seed = seed
        self.device = device
        self.stopwatch = Stopwatch()
        self.cameras = CameraStatistics()
        self.search_counts: SearchCounts = Counter()
        self.followed_by: Counter[FollowedBy] = Counter()

    def __len__(self) -> int:
        return len(self.recording)

    def __iter__(self) -> Iterator[TrackerStep]:
        return (step for _, _, step in self.numbered())

    def numbered(self, warn: Callable[[str], None] = lambda _: None) -> Iterator[tuple[int, StereoFrame, TrackerStep]]:
        """Yield the number of each frame (as `Recording.numbered`), the frame, and the tracker's step.

        `warn` receives a line when cameras that are declared fixed first move.
        """
        self.stopwatch.ms.clear()
        self.cameras = CameraStatistics(warn)
        self.followed_by.clear()
        tracker = tracker_for(self.recording, self.params, self.seed, self.stopwatch)
        self.search_counts = tracker.search_counts

        def one_by_one(frames: Sequence[StereoFrame]) -> list[TrackerStep]:
            return [tracker.step(frame) for frame in frames]

        size, steps_of = 1, one_by_one
        if self.device is not None:
            from tracking.batch import BatchTracker  # loads torch and kornia, which takes seconds

            size, steps_of = _BATCH_PAIRS, BatchTracker(tracker, torch_device(self.device)).steps
        for batch in chunks(self.recording.read_ahead(), size):
            with self.stopwatch("total", len(batch)):
                steps = steps_of([frame for _, frame in batch])
            self.cameras.add(tracker.camera_motion, steps[-1].track.stamp_s)
            for (number, frame), step in zip(batch, steps, strict=True):
                if step.followed_by and step.track.is_known:
                    self.followed_by[step.followed_by] += 1
                yield number, frame, step

    def path(self, steps: Iterable[TrackerStep], smooth: bool) -> Iterator[TrackerStep]:
        """Yield `steps`; with `smooth` later, their tracks corrected by later measurements (RTS smoothing).

        InputError if there is no step: no stereo pair was readable.
        """
        step = None
        for step in smoothed_steps(self.params.kalman, steps) if smooth else steps:
            yield step
        if step is None:
            raise InputError(self.recording.name, "no usable frame; expected at least one readable stereo pair")

    def tracked_pairs(self, steps: Iterable[TrackerStep]) -> Iterator[TrackedPair]:
        """Yield each step with the paths of its images, as the writers take it."""
        pairs = iter(self.recording.pairs)
        for step in steps:
            stamp_s = step.track.stamp_s
            left, right = next(pair for pair in pairs if 0.5 * (pair[0].stamp_s + pair[1].stamp_s) == stamp_s)
            yield _tracked_pair((left.path, right.path), step)

    def arrays(self, smooth: bool = False) -> TrackArrays:
        """Track the recording and return the path of the attended object as arrays; `smooth` as in `path`."""
        return track_arrays(step.track for step in self.path(self, smooth))

    def arrays_by_track(self, smooth: bool = False) -> dict[int, TrackArrays]:
        """Track the recording and return the path of each object that was known, by `track_id`; `smooth` as in
        `path`."""
        steps = list(self.path(self, smooth))
        known = [{track.track_id: track for track in step.tracks if track.is_known} for step in steps]
        return {
            track_id: track_arrays(
                row.get(track_id, Track3D.unknown(step.track.stamp_s)) for row, step in zip(known, steps, strict=True)
            )
            for track_id in sorted({track_id for row in known for track_id in row})
        }


def _tracked_pair(images: tuple[Path, Path], step: TrackerStep) -> TrackedPair:
    residual_px = step.observation.residual_px if step.observation else np.nan
    others = tuple(_tracked_pair(images, other) for other in step.others if other.track.is_known)
    return TrackedPair(images, step.track, step.detections, residual_px, others)


def track_arrays(tracks: Iterable[Track3D]) -> TrackArrays:
    """Return one track of each pair as arrays."""
    rows = []
    covs = []
    status = []
    for track in tracks:
        rows.append((track.stamp_s, *track.position, *track.velocity, track.radius_m, track.track_id))
        covs.append(track.cov[:6, :6].copy())
        status.append(track.status.value)
    table = np.array(rows)
    path = table[:, 0], table[:, 1:4], table[:, 4:7], np.array(covs), table[:, 7], np.array(status)
    return TrackArrays(*path, table[:, 8].astype(int))


def track(
    recording: Recording | Path | str,
    mode: Mode | None = None,
    order: int | None = None,
    *,
    reduction: int | None = None,
    objects: int | None = None,
    params: TrackerParams | None = None,
    device: str | None = None,
    seed: int = 0,
) -> TrackedRecording:
    """Track the moving objects of a recording in 3D.

    `for step in track(recording)` gives one `TrackerStep` for each stereo pair during tracking: the attended object's,
    with the others' tracks; `track(recording).arrays()` gives the whole path of the attended object as arrays,
    `arrays_by_track()` every object's.

    Args:
        recording: A recording, or the folder of an iCub's recording.
        mode: "generic" (default) tracks any moving object, "marker" a green marker.
        order: Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk (default 4).
        reduction: Average each block of this many pixels a side to one before searching (default 1).
        objects: Largest number of objects followed at a time, 1–4 (default 4).
        params: All parameters of the tracker.
        device: Process batches of frames with torch on this device (cpu, cuda, cuda:1); None: frame by frame, without
            torch.
        seed: Seed of the particles.

    Raises:
        InputError: The recording cannot be read or has no calibration, or `mode`, `order`, `reduction` or `objects`
            contradicts `params` or is out of range.
    """
    expect_kinds("track", locals(), track.__annotations__)
    tracker_parameters = tracker_params(mode, order, reduction, objects, params)
    if not isinstance(recording, Recording):
        recording = open_recording(recording)
    return TrackedRecording(recording, tracker_parameters, seed, device)


def tracker_params(
    mode: Mode | None,
    order: int | None = None,
    reduction: int | None = None,
    objects: int | None = None,
    params: TrackerParams | None = None,
) -> TrackerParams:
    """Return the tracker's parameters for the options of `track` (None: not given); InputError if one contradicts
    `params` or is out of range."""
    if objects is not None and objects not in OBJECTS:
        raise InputError("track", f"{objects} objects; expected {OBJECTS[0]} to {OBJECTS[-1]}")
    if params is None:
        return TrackerParams(
            mode=mode or "generic",
            reduction=1 if reduction is None else reduction,
            max_objects=DEFAULT_OBJECTS if objects is None else objects,
            kalman=KalmanParams.of_order(DEFAULT_ORDER if order is None else order),
        )
    given = {
        "mode": (mode, params.mode),
        "order": (order, params.kalman.order),
        "reduction": (reduction, params.reduction),
        "objects": (objects, params.max_objects),
    }
    for name, (value, in_params) in given.items():
        if value not in (None, in_params):
            problem = f"{name} {value} contradicts params with {name} {in_params}"
            raise InputError("track", f"{problem}; expected one of the two")
    return params


def following(
    params: TrackerParams, hue_deg: float | None, left: BoxPx | None = None, right: BoxPx | None = None
) -> TrackerParams:
    """Return the parameters with the object to follow: a marker of this hue (degrees), or the object in these boxes of
    the first images.  InputError for one box without the other."""
    if (left is None) != (right is None):
        raise InputError("track", "one of --init-left and --init-right; expected both, or none")
    if hue_deg is not None:
        params = replace(params, mode="marker", marker=replace(params.marker, hue_deg=hue_deg % 360))
    return params if left is None or right is None else replace(params, initial_boxes=(left, right))


def tracker_for(recording: Recording, params: TrackerParams, seed: int, stages: Stages | None = None) -> Tracker:
    """Return a tracker for the recording's cameras, InputError without a calibration; on a robot, its own body is
    ignored."""
    rig = recording.calibrated()
    side_px = min(min(size) for size in recording.image_sizes)
    if 2 * params.reduction > side_px:
        raise InputError("track", f"reduction {params.reduction}; expected 1 to {side_px // 2}, half an image's side")
    own_body = None
    if recording.robot:
        from pps_vision.robot.silhouette import Silhouette  # loads the kinematics

        own_body = Silhouette(recording.robot)
    timed = {} if stages is None else {"stages": stages}
    return Tracker(params, rig, np.random.default_rng(seed), own_body, **timed)


def chunks(items: Iterable[T], size: int) -> Iterator[list[T]]:
    """Yield all items in order, `size` at a time (the last list may be shorter)."""
    source = iter(items)
    while chunk := list(islice(source, size)):
        yield chunk


def torch_device(name: str) -> "torch.device":
    """The device of that name: cpu, cuda or cuda:INDEX; InputError where this machine does not have it."""
    import torch  # takes seconds to load, and most commands do without

    n = torch.cuda.device_count()
    devices = {"cpu", *(["cuda"] if n else []), *(f"cuda:{index}" for index in range(n))}
    if name not in devices:
        expected = " or ".join(sorted(devices))
        raise InputError(f"--device {name}", f"torch finds {n} CUDA devices on this machine; expected {expected}")
    return torch.device(name)
