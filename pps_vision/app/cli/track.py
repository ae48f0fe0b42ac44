"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro import MISSING

from pps_vision.app.cli.options import RecordingSource, TrackOptions, command_line, print_skipped
from pps_vision.errors import InputError
from pps_vision.recordings import SUMMARY

if TYPE_CHECKING:
    from learning.reach.map import TrackReachability
    from pps_vision.app.pipeline import TrackActivation
    from pps_vision.recordings.recording import Recording


@dataclass(frozen=True)
class Track(TrackOptions, RecordingSource):
    """Follow moving objects (or a green marker) in both eyes and write their 3D paths.

    Either a recording REC (of an iCub, EuRoC, KITTI, or a side-by-side video), or --left, --right and --calib for any
    stereo images or videos; the root frame is the left camera's where there is no robot.
    """

    out: Path = MISSING
    """Folder for detections.csv, trajectory.csv, summary.json, and optional files."""

    def run(self) -> None:
        from math import degrees

        from tqdm import tqdm

        from pps_vision.app.progress import progress
        from pps_vision.app.track import following, track, tracker_params
        from pps_vision.app.track_files import Extras, TrackFiles, diagnosis_of, headline, summary
        from pps_vision.app.track_statistics import TracksStatistics
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import whole_folder, write_json
        from pps_vision.types import ReachStatus

        self._check_robot_options(self.rec is not None, "with --left and --right; expected it with REC")
        with whole_folder(self.out) as folder:
            recording = self.open()
            late = None
            if self.clock == "auto":
                from pps_vision.app.clock import clocks, corrected  # loads SciPy's splines

                late = clocks(recording)
                recording = corrected(recording, late)
            has_robot = recording.robot is not None
            self._check_robot_options(has_robot, "without a robot; expected it with an iCub's REC")
            activation = self._activation(recording)
            offsets = activation.offsets_rad.tolist() if activation else []
            recording = recording.with_joint_offsets(offsets)
            objects = 1 if self.one or self.init_left else self.objects
            params = tracker_params(self.mode, self.order, self.reduction, objects)
            params = following(params, self.hue, self.init_left, self.init_right)
            run = track(recording, params=params, device=self.device, seed=self.seed)
            reach = self._reach(recording)
            extras = Extras(self.also, self.video, self.viewer, self.report, reach, activation)
            statistics = TracksStatistics(recording.truth)
            with TrackFiles(folder, run, extras) as files:
                numbered = run.numbered(lambda line: tqdm.write(f"warning: {line}", file=sys.stderr))
                steps = files.steps(progress(numbered, total=len(run), desc="track", unit="pair"))
                for pair in run.tracked_pairs(run.path(steps, self.smooth)):
                    statistics.add(pair)
                    files.add(pair)
            diagnosis = diagnosis_of(run, statistics.attended, files.sample)
            content = summary(run, statistics.attended, diagnosis)
            if late:
                content["clock"] = late.numbers()
            content["objects"] = params.max_objects
            content["tracks"] = statistics.summary()
            content["smoothed"] = self.smooth
            content["joints"] = str(self.joints) if self.joints else None
            content["map"] = str(self.map) if self.map else None
            content["memory"] = str(self.memory) if self.memory else None
            if offsets and recording.robot:
                content["joint_offsets_deg"] = dict(
                    zip(recording.robot.joint_names, map(degrees, offsets), strict=True)
                )
            content["versions"] = versions()
            content["command"] = command_line("track", self)
            if reach:
                counts = {status.value: files.reached[status] for status in ReachStatus}
                content["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / SUMMARY, content)
            if self.report:
                from pps_vision.app.report.tracking import write_report  # draws with matplotlib

                write_report(folder)
        print_skipped(recording.problems, recording.warnings)
        if late:
            print(late)
        print(headline(run, statistics.attended, len(statistics)), f"→ {self.out}")
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
        from learning.reach.map import ReachableMap, TrackReachability

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
        check_memory(memory, skin, self.memory, recording.robot)
        return TrackActivation(recording.robot, skin, memory)
