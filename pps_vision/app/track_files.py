"""Results of `pps-vision track`: files, row by row while it tracks, then a summary, one line, and the diagnosis of a
failure."""

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pps_vision.app.diagnosis import Diagnosis, FrameSample, diagnose
from pps_vision.app.report.overlay import VideoFile, draw_pair, save_jpeg
from pps_vision.app.results import TrackSummary
from pps_vision.app.track import TrackedRecording
from pps_vision.app.track_statistics import PathStatistics
from pps_vision.recordings import KEY_FRAMES, Form, tables
from pps_vision.recordings.exchange import TrackedPair, open_forms
from pps_vision.recordings.warnings import count_by_kind
from pps_vision.types import Array, Image, ReachStatus, Status, StereoFrame
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


class TrackFiles(AbstractContextManager["TrackFiles"]):
    """Open output files of a recording that is being tracked.

    `steps` writes the causal results of each pair and yields the tracker's steps; `add` writes the path, which may be
    smoothed and come later.  `sample` keeps the frames for the diagnosis.
    """

    def __init__(self, folder: Path, run: TrackedRecording, extras: Extras) -> None:
        """InputError if an extra needs a package that is not installed."""
        self.reached: Counter[ReachStatus] = Counter()  # number of pairs by reachability
        self._folder = folder
        self._run = run
        self.sample = FrameSample(run.recording)
        self._extras = extras
        self._joints: deque[Array] = deque()  # joints for steps whose path was not added yet
        self._key_frames: list[Image] = []
        self._key_frame_interval = -(-len(run) // _KEY_FRAMES)
        recording = run.recording
        with ExitStack() as files:
            self._film = files.enter_context(VideoFile(folder / "overlay.mp4", recording.fps))
            self._write_detection = files.enter_context(tables.open_table(folder / "detections.csv", tables.DETECTIONS))
            columns = tables.TRAJECTORY + tables.REACHABILITY if extras.reach else tables.TRAJECTORY
            self._write_track = files.enter_context(tables.open_table(folder / "trajectory.csv", columns))
            self._write_forms = files.enter_context(open_forms(folder, extras.also, recording.image_size))
            if extras.activation:
                taxels = ("stamp_s", *extras.activation.skin.taxel_ids)
                self._write_activation = files.enter_context(tables.open_table(folder / tables.ACTIVATION, taxels))
            self._view = None
            if extras.viewer:
                from pps_vision.app.report.viewer import VIEW, ViewFile

                self._view = files.enter_context(ViewFile(folder / VIEW))
            self._files = files.pop_all()

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
            self.sample.add(frame)
            attended, skin = self._activation(frame, step)
            known = [other for other in attended.others if other.track.is_known]
            for item in (attended, *known):
                for detection in item.detections:
                    self._write_detection(tables.detection_row(number, detection, item.track))
            if self._view:
                self._view.add(frame, attended)
            self._draw(k, frame, attended, skin)
            yield attended

    def add(self, pair: TrackedPair) -> None:
        """Write the next row of the path, and one for each other known track."""
        reach = self._extras.reach
        joints = self._joints.popleft() if reach else None
        for item in pair.objects:
            reachability = reach(joints, item.track) if reach and joints is not None else None
            if reachability and item is pair:
                self.reached[reachability.status] += 1
            self._write_track(tables.trajectory_row(item.track, reachability))
        self._write_forms(pair)

    def _activation(self, frame: StereoFrame, step: TrackerStep) -> tuple[TrackerStep, tuple[Array, Array] | tuple[()]]:
        """Write the activation; keep the joints for `add`.

        Returns the step with the object attended that most activates the skin, and the positions and activations of
        the taxels.
        """
        if not (self._extras.reach or self._extras.activation):
            return step, ()
        from pps_vision.app.pipeline import joints_of

        joints = joints_of(frame)
        if self._extras.reach:
            self._joints.append(joints)
        if not self._extras.activation:
            return step, ()
        attended, activation, taxels = self._extras.activation(joints, step)
        self._write_activation((activation.stamp_s, *activation.probability))
        return attended, (taxels, activation.probability)

    def _draw(self, k: int, frame: StereoFrame, step: TrackerStep, skin: tuple[Array, Array] | tuple[()]) -> None:
        """Draw the pair if it goes into the video or is a key frame."""
        is_key_frame = self._extras.key_frames and k % self._key_frame_interval == self._key_frame_interval // 2
        if not (self._extras.video or is_key_frame):
            return
        view = self._run.recording.calibrated().view_of(frame)
        picture = draw_pair(frame, view, step, *skin)
        if self._extras.video:
            self._film.add(picture)
        if is_key_frame:
            self._key_frames.append(picture)


def diagnosis_of(run: TrackedRecording, path: PathStatistics, sample: FrameSample | None = None) -> Diagnosis | None:
    """Return why hardly anything was tracked or positions are wrong, and what to try; None if neither is the case."""
    rotation = (run.cameras.rotation_deg, run.cameras.rotation_deg_s)
    return diagnose(
        run.recording, run.params.mode, run.search_counts, path.tracked_share, rotation, path.residual_px, sample
    )


def summary(run: TrackedRecording, path: PathStatistics, diagnosis: Diagnosis | None = None) -> TrackSummary:
    """Return the settings and results of tracking, for summary.json."""
    content: TrackSummary = {
        "source": run.recording.name,
        "mode": run.params.mode,
        "reduction": run.params.reduction,
        "device": run.device,
        "seed": run.seed,
        "pairs": len(run),
        "frames": path.frames,
        "status": {status.value: path.status[status] for status in Status},
        "followed_by": {str(cue): n for cue, n in run.followed_by.items()},
        "ms_per_pair": run.stopwatch.summary(),
        "cameras": run.cameras.summary(),
        "skipped": count_by_kind(run.recording.problems),
        "warnings": [*run.recording.warnings],
    }
    if path.tracked_share:
        content["object"] = path.size()
        content["residual_px"] = path.residual_px
    if diagnosis:
        content["diagnosis"] = {"counts": diagnosis.counts, "advice": [*diagnosis.advice]}
    if run.recording.truth:
        content["errors"] = path.errors()
    return content


def headline(run: TrackedRecording, path: PathStatistics, tracks: int = 1) -> str:
    """Return the main results in one line for the terminal: the attended object's, and the number of tracks."""
    n_tracked = path.status[Status.TRACKING]
    median_ms = np.median(run.stopwatch.ms["total"])
    parts = [f"{n_tracked} of {path.frames} pairs tracked", f"median {median_ms:.1f} ms a pair"]
    if run.recording.truth:
        errors = path.errors()
        if np.isfinite(rms_all_mm := errors["position_rms_all_mm"]):
            parts.append(f"3D RMS {errors['position_rms_mm']:.2f} mm where tracked")
            parts.append(f"{rms_all_mm:.2f} mm with predicted positions")
    if n_tracked:
        size = path.size()
        interval = f"{1000 * size['low_95_m']:.3g}–{1000 * size['high_95_m']:.3g}"
        parts.append(f"object {1000 * size['diameter_m']:.3g} mm across (95 %: {interval})")
    if tracks > 1:
        parts.append(f"{tracks} tracks")
    if run.recording.skipped:
        parts.append(f"{run.recording.skipped} problems skipped")
    return ", ".join(parts)
