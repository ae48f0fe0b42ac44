"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import tyro
from tqdm import tqdm

from pps_vision.app.budget import Choice, cheapest
from pps_vision.app.device import torch_device
from pps_vision.app.overlay import VideoFile, draw_pair
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.calibration import read_icub_eyes
from pps_vision.recordings.images import open_stereo_images
from pps_vision.recordings.joint_table import read_joint_offsets
from pps_vision.recordings.opencv_calibration import read_stereo_calibration
from pps_vision.recordings.outputs import whole_folder
from pps_vision.recordings.problems import BadInput, count_by_kind
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.results import write_detections, write_summary, write_trajectory
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Detection2D, Status, StereoFrame, Track3D, Truth
from tracking.smoother import smoothed_tracks
from tracking.tracker import Tracker, TrackerParams, TrackerStep

Mode = Literal["generic", "marker"]
Depth = Literal["centroid", "disparity"]
_FILES = ("detections.csv", "trajectory.csv", "summary.json", "overlay.mp4")
_WARM_UP = 10  # frames a tracker is given before its errors count


@dataclass(frozen=True)
class Track:
    """Follow a moving object (or a green marker) in both eyes and write its 3D path.

    Either a recording folder REC of an iCub (yarpdatadumper layout, as `render` writes it), or
    --left, --right, --calib and --fps for any stereo images; the root frame is then the left camera.
    """

    rec: tyro.conf.Positional[Path | None] = None
    """Recording folder."""
    out: Path = tyro.MISSING
    """Folder for detections.csv, trajectory.csv, summary.json (and overlay.mp4)."""
    left: tuple[str, ...] = ()
    """Left images: a pattern in quotes such as 'seq/left*.png', or the files themselves."""
    right: tuple[str, ...] = ()
    """Right images, paired with the left ones by the last number in their names."""
    calib: tuple[Path, ...] = ()
    """Calibration: OpenCV files (one for all, or left, right and stereo), or icubEyes.ini for a REC without its own."""
    joints: Path | None = None
    """What to add to the encoders of REC, as `pps-vision joints` writes it."""
    fps: float = 30.0
    """Frames per second of --left/--right."""
    unit_m: float = 1.0
    """Metres per length unit of the OpenCV calibration (0.01 if its board was measured in cm)."""
    mode: Mode = "generic"
    """generic: whatever moves; marker: a green marker, the cheaper road."""
    depth: Depth = "centroid"
    """centroid: where both eyes see the centre; disparity: matching inside the region, for textured objects."""
    max_error_mm: float | None = None
    """Instead of --mode and --depth: the cheapest way whose 3D RMS error is within this; summary.json says which and
    why."""
    device: str | None = None
    """Process batches of frames with torch on this device (cpu, cuda, cuda:1), for long recordings; default: frame by
    frame, without torch."""
    batch: int = 16
    """Stereo pairs in a batch of --device."""
    smooth: bool = False
    """Let what is seen later correct what was seen before (RTS smoothing): trajectory.csv and the errors are those of
    the smoothed path; the video shows the path as it was known then."""
    max_skew_s: float = 0.02
    """Left and right images further apart in time are no pair."""
    video: bool = False
    """Also write overlay.mp4."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Read, track, and write everything at once; what had to be skipped is reported."""
        stopwatch = Stopwatch()
        recording, make_tracker = self._open(stopwatch)
        choice = None if self.max_error_mm is None else cheapest(recording, self.max_error_mm, make_tracker)
        params = choice.configuration.params if choice else TrackerParams(mode=self.mode, depth=self.depth)
        stopwatch.ms.clear()
        tracker = make_tracker(params)
        detections: list[tuple[int, Detection2D, Status]] = []
        steps: list[TrackerStep] = []
        with whole_folder(self.out, _FILES) as folder:
            with VideoFile(folder / "overlay.mp4", _rate(recording)) as film:
                frames = tqdm(recording.numbered(), total=len(recording), desc="track", unit="pair", disable=None)
                for number, frame, step in self._steps(frames, tracker, stopwatch):
                    steps.append(step)
                    detections += [(number, seen, step.track.status) for seen in step.detections]
                    if self.video:
                        film.add(draw_pair(frame, tracker.rig.view_of(frame), step.track, step.detections))
            if not steps:
                raise BadInput(recording.name, "no usable frame; expected at least one readable stereo pair")
            tracks = smoothed_tracks(params.kalman, steps) if self.smooth else [step.track for step in steps]
            write_detections(folder / "detections.csv", detections)
            write_trajectory(folder / "trajectory.csv", tracks)
            write_summary(folder / "summary.json", self._summary(recording, params, choice, tracks, stopwatch))
        for problem in recording.problems:
            print(f"skipped: {problem}", file=sys.stderr)
        print(_headline(tracks, recording, stopwatch), f"→ {self.out}")

    def _open(self, stopwatch: Stopwatch) -> tuple[Recording, Callable[[TrackerParams], Tracker]]:
        if self.max_error_mm is not None and (self.mode, self.depth) != ("generic", "centroid"):
            raise ValueError("track: --max-error-mm chooses the mode and the depth itself; expected no --mode, --depth")
        if self.batch < 1:
            raise ValueError(f"track: --batch {self.batch}; expected at least 1")
        if (self.rec is None) == (not self.left and not self.right):
            raise ValueError("track: expected either a recording folder REC, or --left and --right with --calib")
        if self.rec is not None:
            if len(self.calib) > 1:
                raise ValueError(f"track: {len(self.calib)} files after --calib; expected one icubEyes.ini with REC")
            names = load_icub().joint_names
            offsets = read_joint_offsets(self.joints, names) if self.joints else np.zeros(len(names))
            recording = open_yarp(self.rec, self.max_skew_s, joint_offsets_rad=offsets)
            return recording, lambda params: tracker_for(recording, params, self.seed, stopwatch, *self.calib)
        if self.joints:
            raise ValueError(f"track: --joints {self.joints} with --left and --right; expected it with REC")
        if not (self.left and self.right and self.calib):
            raise ValueError("track: --left, --right and --calib go together; one is missing")
        recording = open_stereo_images(self.left, self.right, self.fps)
        left, right, T_left_right = read_stereo_calibration(self.calib, recording.image_size, self.unit_m)
        rig = StereoRig.fixed(left, right, T_left_right)
        return recording, lambda params: Tracker(params, rig, np.random.default_rng(self.seed), stages=stopwatch)

    def _steps(
        self, frames: Iterable[tuple[int, StereoFrame]], tracker: Tracker, stopwatch: Stopwatch
    ) -> Iterator[tuple[int, StereoFrame, TrackerStep]]:
        """Frame by frame, or in batches."""
        if self.device is None:
            for number, frame in frames:
                with stopwatch("total"):
                    step = tracker.step(frame)
                yield number, frame, step
            return
        from tracking.batch import BatchTracker  # loads torch and kornia, which takes seconds

        batches = BatchTracker(tracker, torch_device(self.device))
        for chunk in chunks(frames, self.batch):
            with stopwatch("total", len(chunk)):
                steps = batches.steps([frame for _, frame in chunk])
            yield from ((number, frame, step) for (number, frame), step in zip(chunk, steps, strict=True))

    def _summary(
        self,
        recording: Recording,
        params: TrackerParams,
        choice: Choice | None,
        tracks: list[Track3D],
        stopwatch: Stopwatch,
    ) -> dict[str, object]:
        summary: dict[str, object] = {
            "source": recording.name,
            "joints": str(self.joints) if self.joints else None,
            "mode": params.mode,
            "depth": params.depth,
            "device": self.device,
            "smoothed": self.smooth,
            "seed": self.seed,
            "pairs": len(recording),
            "frames": len(tracks),
            "status": {status.value: sum(track.status == status for track in tracks) for status in Status},
            "ms_per_pair": stopwatch.summary(),
            "skipped": count_by_kind(recording.problems),
        }
        if choice:
            summary["max_error"] = {"asked_mm": self.max_error_mm, **choice.summary()}
        if recording.truth:
            summary["errors"] = errors_against(recording.truth, tracks)
        return summary


def tracker_for(
    recording: Recording, params: TrackerParams, seed: int, stopwatch: Stopwatch, calibration: Path | None = None
) -> Tracker:
    """A tracker for an iCub's recording, with its own calibration unless another is given."""
    eyes = calibration or recording.calibration
    if eyes is None:
        raise BadInput(recording.name, "holds no icubEyes.ini; expected a calibration there or by --calib")
    robot = load_icub()
    rig = icub_rig(robot, *read_icub_eyes(eyes, recording.image_size))
    return Tracker(params, rig, np.random.default_rng(seed), own_body=Silhouette(robot), stages=stopwatch)


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


def _rate(recording: Recording) -> float:
    """Frames a second, for the video."""
    steps = np.diff([left.stamp_s for left, _ in recording.pairs])
    usual = float(np.median(steps)) if len(steps) else 0.0
    return 1 / usual if usual > 0 else 20.0


def _headline(tracks: list[Track3D], recording: Recording, stopwatch: Stopwatch) -> str:
    tracked = sum(track.status == Status.TRACKING for track in tracks)
    line = f"{tracked} of {len(tracks)} pairs tracked, median {np.median(stopwatch.ms['total']):.1f} ms a pair"
    if recording.truth:
        errors = errors_against(recording.truth, tracks)
        if np.isfinite(errors["position_rms_mm"]):
            line += f", 3D RMS {errors['position_rms_mm']:.2f} mm"
    return line + (f", {len(recording.problems)} problems skipped" if recording.problems else "")
