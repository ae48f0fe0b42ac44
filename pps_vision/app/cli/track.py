"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro import MISSING

from pps_vision.app.cli.options import SourceOptions, command_line, print_skipped
from pps_vision.errors import InputError
from pps_vision.recordings import SUMMARY, Form
from tracking import DEFAULT_ORDER, Mode, Model

if TYPE_CHECKING:
    from learning.reach.track_reachability import TrackReachability
    from pps_vision.app.pipeline import TrackActivation
    from pps_vision.recordings.recording import Recording
    from tracking.flight import FlightParams


@dataclass(frozen=True)
class Track(SourceOptions):
    """Follow a moving object (or a green marker) in both eyes and write its 3D path.

    Either a recording REC (of an iCub, EuRoC, KITTI, or a side-by-side video), or --left, --right and --calib for any
    stereo images or videos; the root frame is the left camera's where there is no robot.
    """

    out: Path = MISSING
    """Folder for detections.csv, trajectory.csv, summary.json, and what else is asked for."""
    map: Path | None = None
    """Reachable-space map of `pps-vision reach train`: trajectory.csv then also holds, for every frame of REC, the gaze
    that fixates the object (gaze_yaw_deg, gaze_pitch_deg, gaze_vergence_deg) and whether the hand can reach it
    (reach_probability, reach_degree, reach_status: reachable, unreachable, not fixated by any gaze the map knows, or
    unknown without a track)."""
    max_fp: float = 1e-3
    """Share of unreachable places that --map may call reachable."""
    memory: Path | None = None
    """Memory of `pps-vision learn`: activation.csv then holds, for every frame of REC, the probability with which each
    taxel of the iCub's skin is about to be touched, and the video and the report show it."""
    mode: Mode = "generic"
    """generic: whatever moves; marker: a green marker (faster)."""
    order: int = DEFAULT_ORDER
    """Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk."""
    model: Model = "kalman"
    """What predicts the motion. kalman: position and its derivatives (--order), for what is moved; flight: a thrown
    table-tennis ball's gravity, drag, spin and bounce."""
    up: tuple[float, float, float] | None = None
    """Of --model flight: the upward direction in the root frame (default: z on a robot, else up in the left image)."""
    floor_m: float | None = None
    """Of --model flight: height along --up at which the ball's centre bounces, from the root frame's origin (default:
    no bounce)."""
    reduction: int = 1
    """Average each block of so many pixels a side to one before looking: about half the time in large images at 2, for
    two to three times the error."""
    max_error_mm: float | None = None
    """Instead of --mode, --order, --model and --reduction: the fastest configuration whose 3D RMS error is within this;
    summary.json says which and why."""
    device: str | None = None
    """Process batches of frames with torch on this device (cpu, cuda, cuda:1), for long recordings; default: frame by
    frame, without torch."""
    smooth: bool = False
    """Smooth the path with later measurements (RTS smoothing): trajectory.csv and the errors are those of
    the smoothed path; video, view and activation.csv show what was known then."""
    also: tuple[Form, ...] = ()
    """Also write the forms of other tools: tum (evo), anipose (movement), mot and coco (boxes in the images), ros2
    (a bag; extra `ros`)."""
    video: bool = False
    """Also write overlay.mp4."""
    viewer: bool = False
    """Also write view.rrd for the Rerun viewer (extra `viewer`): images, detections, 3D path with its covariance,
    distance and time to contact over the stamps; takes 5 MB of memory for 1 000 pairs."""
    report: bool = False
    """Also write report.html with images, tracks, a 3D path to turn, times and warnings, and its key frames; takes
    3.5 MB of memory for 1 000 pairs, at the end."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Read, track, and write everything at once; what had to be skipped is printed."""
        from tqdm import tqdm

        from pps_vision.app.progress import progress
        from pps_vision.app.report.tracking import write_report
        from pps_vision.app.track import PathNumbers, track
        from pps_vision.app.track_files import Extras, TrackFiles
        from pps_vision.app.versions import versions
        from pps_vision.recordings.outputs import whole_folder, write_json
        from pps_vision.types import ReachStatus
        from tracking.kalman import KalmanParams
        from tracking.tracker import TrackerParams

        self._refuse_without(self.rec is not None, "with --left and --right; expected it with REC")
        with whole_folder(self.out) as folder:
            recording = self.open()
            self._refuse_without(recording.robot is not None, "without a robot; expected it with an iCub's REC")
            kalman, flight = KalmanParams.of_order(self.order), self._flight(recording)
            params = TrackerParams(self.mode, self.reduction, kalman=kalman, flight=flight)
            run = track(recording, params=params, max_error_mm=self.max_error_mm, device=self.device, seed=self.seed)
            reach, activation = self._reach(recording), self._activation(recording)
            numbers = PathNumbers(recording.truth)
            extras = Extras(self.also, self.video, self.viewer, self.report, reach, activation)
            with TrackFiles(folder, run, extras) as files:
                numbered = run.numbered(lambda line: tqdm.write(f"warning: {line}", file=sys.stderr))
                bar = progress(numbered, total=len(run), desc="track", unit="pair")
                for pair in run.tracked_pairs(run.path(files.steps(bar), self.smooth)):
                    numbers.add(pair.track, pair.residual_px)
                    files.add(pair)
            diagnosis = run.diagnosis(numbers)
            summary = run.summary(numbers, diagnosis) | {
                "smoothed": self.smooth,
                "joints": self.joints,
                "map": self.map,
                "memory": self.memory,
                "versions": versions(),
                "command": command_line("track", self),
            }
            if reach:
                counts = {status.value: files.reached[status] for status in ReachStatus}
                summary["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / SUMMARY, summary)
            if self.report:
                write_report(folder)
        print_skipped(recording.problems, recording.warnings)
        print(run.headline(numbers), f"→ {self.out}")
        if diagnosis:
            print(diagnosis)

    def _refuse_without(self, robot: bool, why: str) -> None:
        """InputError for what is only of use with a robot, where there is none."""
        for option, file in {"--map": self.map, "--memory": self.memory}.items():
            if file and not robot:
                raise InputError("track", f"{option} {file} {why}")

    def _flight(self, recording: "Recording") -> "FlightParams | None":
        """What --model flight, --up and --floor-m say; InputError for options of the other model."""
        from tracking.flight import FlightParams

        flight = self.model == "flight"
        others = (("order", DEFAULT_ORDER),) if flight else (("up", None), ("floor_m", None))
        for name, default in others:
            if (value := getattr(self, name)) != default:
                option = f"--{name.replace('_', '-')}"
                raise InputError(
                    "track", f"{option} {value}; expected it only with --model {'kalman' if flight else 'flight'}"
                )
        if not flight:
            return None
        up = self.up or ((0.0, 0.0, 1.0) if recording.robot else (0.0, -1.0, 0.0))
        return FlightParams(up=up, floor_m=-math.inf if self.floor_m is None else self.floor_m)

    def _reach(self, recording: "Recording") -> "TrackReachability | None":
        """What --map answers."""
        if not (self.map and recording.robot):
            return None
        from learning.reach.map import ReachableMap
        from learning.reach.track_reachability import TrackReachability

        return TrackReachability(recording.robot, ReachableMap.load(self.map), self.max_fp)

    def _activation(self, recording: "Recording") -> "TrackActivation | None":
        """What --memory answers."""
        if not (self.memory and recording.robot):
            return None
        from learning.pps.memory import load_memory
        from pps_vision.app.pipeline import TrackActivation, check_memory
        from pps_vision.robot.skin import icub_skin

        memory, skin = load_memory(self.memory), icub_skin()
        check_memory(memory, skin, self.memory)
        return TrackActivation(recording.robot, skin, memory)
