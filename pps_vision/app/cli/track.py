"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro import MISSING

from pps_vision.app.cli.options import SourceOptions, command_line, print_skipped
from pps_vision.errors import InputError
from pps_vision.recordings import SUMMARY, Form
from tracking import DEFAULT_ORDER, Mode

if TYPE_CHECKING:
    from learning.reach.track_reachability import TrackReachability
    from pps_vision.app.pipeline import TrackActivation
    from pps_vision.recordings.recording import Recording


@dataclass(frozen=True)
class Track(SourceOptions):
    """Follow a moving object (or a green marker) in both eyes and write its 3D path.

    Either a recording REC (of an iCub, EuRoC, KITTI, or a side-by-side video), or --left, --right and --calib for any
    stereo images or videos; the root frame is the left camera's where there is no robot.
    """

    out: Path = MISSING
    """Folder for detections.csv, trajectory.csv, summary.json, and optional files."""
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
    """generic: any moving object; marker: a green marker (faster)."""
    order: int = DEFAULT_ORDER
    """Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk."""
    reduction: int = 1
    """Average each block of this many pixels a side to one before searching: about half the time in large images at 2,
    for two to three times the error."""
    device: str | None = None
    """Process batches of frames with torch on this device (cpu, cuda, cuda:1), for long recordings; default: frame by
    frame, without torch."""
    smooth: bool = False
    """Smooth the path with later measurements (RTS smoothing): trajectory.csv and the errors are those of
    the smoothed path; video, view and activation.csv show the causal track."""
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
        """Track the recording, write all files at once, and print the main results and skipped items."""
        from tqdm import tqdm

        from pps_vision.app.progress import progress
        from pps_vision.app.report.tracking import write_report
        from pps_vision.app.track import track
        from pps_vision.app.track_files import Extras, TrackFiles
        from pps_vision.app.track_statistics import PathStatistics
        from pps_vision.app.track_summary import diagnosis_of, headline, summary
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import whole_folder, write_json
        from pps_vision.types import ReachStatus

        self._check_robot_options(self.rec is not None, "with --left and --right; expected it with REC")
        with whole_folder(self.out) as folder:
            recording = self.open()
            has_robot = recording.robot is not None
            self._check_robot_options(has_robot, "without a robot; expected it with an iCub's REC")
            run = track(recording, self.mode, self.order, reduction=self.reduction, device=self.device, seed=self.seed)
            reach = self._reach(recording)
            extras = Extras(self.also, self.video, self.viewer, self.report, reach, self._activation(recording))
            statistics = PathStatistics(recording.truth)
            with TrackFiles(folder, run, extras) as files:
                numbered = run.numbered(lambda line: tqdm.write(f"warning: {line}", file=sys.stderr))
                steps = files.steps(progress(numbered, total=len(run), desc="track", unit="pair"))
                for pair in run.tracked_pairs(run.path(steps, self.smooth)):
                    statistics.add(pair.track, pair.residual_px)
                    files.add(pair)
            diagnosis = diagnosis_of(run, statistics)
            content = summary(run, statistics, diagnosis) | {
                "smoothed": self.smooth,
                "joints": self.joints,
                "map": self.map,
                "memory": self.memory,
                "versions": versions(),
                "command": command_line("track", self),
            }
            if reach:
                counts = {status.value: files.reached[status] for status in ReachStatus}
                content["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / SUMMARY, content)
            if self.report:
                write_report(folder)
        print_skipped(recording.problems, recording.warnings)
        print(headline(run, statistics), f"→ {self.out}")
        if diagnosis:
            print(diagnosis)

    def _check_robot_options(self, has_robot: bool, message: str) -> None:
        """InputError for --map or --memory without a robot."""
        for option, file in {"--map": self.map, "--memory": self.memory}.items():
            if file and not has_robot:
                raise InputError("track", f"{option} {file} {message}")

    def _reach(self, recording: "Recording") -> "TrackReachability | None":
        """Return the reachability of a track by --map."""
        if not (self.map and recording.robot):
            return None
        from learning.reach.map import ReachableMap
        from learning.reach.track_reachability import TrackReachability

        return TrackReachability(recording.robot, ReachableMap.load(self.map), self.max_fp)

    def _activation(self, recording: "Recording") -> "TrackActivation | None":
        """Return the activation of the skin by --memory."""
        if not (self.memory and recording.robot):
            return None
        from learning.pps.memory import load_memory
        from pps_vision.app.pipeline import TrackActivation, check_memory
        from pps_vision.robot.skin import icub_skin

        memory = load_memory(self.memory)
        skin = icub_skin()
        check_memory(memory, skin, self.memory)
        return TrackActivation(recording.robot, skin, memory)
