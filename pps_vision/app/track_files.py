"""Files that `pps-vision track` writes, row by row while it tracks."""

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pps_vision.app.report.overlay import VideoFile, draw_pair, save_jpeg
from pps_vision.app.report.tracking import KEY_FRAMES
from pps_vision.app.track import TrackedRecording
from pps_vision.recordings import Form
from pps_vision.recordings.exchange import TrackedPair, open_forms
from pps_vision.recordings.tables import (
    ACTIVATION,
    DETECTIONS,
    REACHABILITY,
    TRAJECTORY,
    detection_row,
    open_table,
    trajectory_row,
)
from pps_vision.types import Activation, Array, Image, ReachStatus, StereoFrame
from tracking.tracker import TrackerStep

if TYPE_CHECKING:  # these modules load the kinematics
    from learning.reach.map import TrackReachability
    from pps_vision.app.pipeline import TrackActivation

_KEY_FRAMES = 8  # in a report without a video


@dataclass(frozen=True)
class Extras:
    """Output besides detections.csv and trajectory.csv."""

    also: tuple[Form, ...]  # forms of other tools
    video: bool  # overlay.mp4
    viewer: bool  # view.rrd
    key_frames: bool  # eight pictures for the report
    reach: "TrackReachability | None"  # columns of reachability in trajectory.csv
    activation: "TrackActivation | None"  # activation.csv, and taxels in the pictures


class TrackFiles:
    """Open output files of a recording that is being tracked.

    `steps` writes the causal results of each pair and yields the tracker's steps; `add` writes the path, which may be
    smoothed and come later.

    Attributes:
        reached: Number of pairs by reachability.
    """

    def __init__(self, folder: Path, run: TrackedRecording, extras: Extras) -> None:
        """InputError if an extra needs a package that is not installed."""
        self.reached: Counter[ReachStatus] = Counter()
        self._folder = folder
        self._run = run
        self._extras = extras
        self._joints: deque[Array] = deque()  # joints for steps whose path was not added yet
        self._key_frames: list[Image] = []
        self._key_frame_interval = -(-len(run) // _KEY_FRAMES)
        recording = run.recording
        with ExitStack() as files:
            self._film = files.enter_context(VideoFile(folder / "overlay.mp4", recording.fps))
            self._write_detection = files.enter_context(open_table(folder / "detections.csv", DETECTIONS))
            columns = TRAJECTORY + REACHABILITY if extras.reach else TRAJECTORY
            self._write_track = files.enter_context(open_table(folder / "trajectory.csv", columns))
            self._write_forms = files.enter_context(open_forms(folder, extras.also, recording.image_size))
            if extras.activation:
                taxels = ("stamp_s", *extras.activation.skin.taxel_ids)
                self._write_activation = files.enter_context(open_table(folder / ACTIVATION, taxels))
            self._view = None
            if extras.viewer:
                from pps_vision.app.report.viewer import VIEW, ViewFile

                self._view = files.enter_context(ViewFile(folder / VIEW))
            self._files = files.pop_all()

    def __enter__(self) -> "TrackFiles":
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if self._view and kind is None:
            self._view.finish(self._run.recording.truth)
        self._files.__exit__(kind, *error)
        if self._extras.key_frames and kind is None:
            (self._folder / KEY_FRAMES).mkdir()
            for k, picture in enumerate(self._key_frames):
                save_jpeg(self._folder / KEY_FRAMES / f"{k}.jpg", picture)

    def steps(self, numbered: Iterable[tuple[int, StereoFrame, TrackerStep]]) -> Iterator[TrackerStep]:
        """Write the causal results of each pair, and yield its step."""
        for k, (number, frame, step) in enumerate(numbered):
            for detection in step.detections:
                self._write_detection(detection_row(number, detection, step.track.status))
            if self._view:
                self._view.add(frame, step)
            self._draw(k, frame, step, self._activation(frame, step))
            yield step

    def add(self, pair: TrackedPair) -> None:
        """Write the next row of the path."""
        reachability = None
        if self._extras.reach:
            reachability = self._extras.reach(self._joints.popleft(), pair.track)
            self.reached[reachability.status] += 1
        self._write_track(trajectory_row(pair.track, reachability))
        self._write_forms(pair)

    def _activation(self, frame: StereoFrame, step: TrackerStep) -> tuple[Activation, Array] | None:
        """Write and return the activation, with the positions of the taxels; keep the joints for `add`."""
        if not (self._extras.reach or self._extras.activation):
            return None
        from pps_vision.app.pipeline import joints_of

        joints = joints_of(frame)
        if self._extras.reach:
            self._joints.append(joints)
        if not self._extras.activation:
            return None
        activation, taxels = self._extras.activation(joints, step.track)
        self._write_activation((activation.stamp_s, *activation.probability))
        return activation, taxels

    def _draw(self, k: int, frame: StereoFrame, step: TrackerStep, activation: tuple[Activation, Array] | None) -> None:
        """Draw the pair if it goes into the video or is a key frame."""
        is_key_frame = self._extras.key_frames and k % self._key_frame_interval == self._key_frame_interval // 2
        if not (self._extras.video or is_key_frame):
            return
        skin = (activation[1], activation[0].probability) if activation else ()
        view = self._run.recording.calibrated().view_of(frame)
        picture = draw_pair(frame, view, step.track, step.detections, *skin)
        if self._extras.video:
            self._film.add(picture)
        if is_key_frame:
            self._key_frames.append(picture)
