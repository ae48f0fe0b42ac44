"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

from collections import Counter, deque
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from tyro import MISSING

from pps_vision.app.cli.options import SourceOptions, command_line, print_skipped
from pps_vision.errors import InputError
from pps_vision.recordings import Form
from tracking import DEFAULT_ORDER, Mode

_KEY_FRAMES = 8  # of a report without a video


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
    max_error_mm: float | None = None
    """Instead of --mode and --order: the fastest configuration whose 3D RMS error is within this; summary.json
    says which and why."""
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
    distance and time to contact over the stamps."""
    report: bool = False
    """Also write report.html with images, tracks, a 3D path to turn, times and warnings, and its key frames."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Read, track, and write everything at once; what had to be skipped is printed."""
        from tqdm import tqdm

        from pps_vision.app.report.overlay import VideoFile, draw_pair, save_jpeg
        from pps_vision.app.track import PathNumbers, track
        from pps_vision.app.versions import versions
        from pps_vision.recordings.exchange import open_forms
        from pps_vision.recordings.outputs import whole_folder, write_json
        from pps_vision.recordings.tables import (
            ACTIVATION,
            DETECTIONS,
            REACHABILITY,
            TRAJECTORY,
            detection_row,
            open_table,
            trajectory_row,
        )
        from pps_vision.types import Array, Image, ReachStatus
        from tracking.kalman import KalmanParams
        from tracking.tracker import TrackerParams, TrackerStep

        for option, file in (given := {"--map": self.map, "--memory": self.memory}).items():
            if file and self.rec is None:
                raise InputError("track", f"{option} {file} with --left and --right; expected it with REC")
        with whole_folder(self.out) as folder:
            recording = self.open()
            for option, file in given.items():
                if file and not recording.robot:
                    raise InputError("track", f"{option} {file} without a robot; expected it with an iCub's REC")
            params = TrackerParams(mode=self.mode, kalman=KalmanParams.of_order(self.order))
            run = track(recording, params=params, max_error_mm=self.max_error_mm, device=self.device, seed=self.seed)
            if self.map or self.memory:
                from pps_vision.app.pipeline import joints_of
            reach = None
            if self.map and recording.robot:
                from learning.reach.map import ReachableMap
                from learning.reach.track_reachability import TrackReachability

                reach = TrackReachability(recording.robot, ReachableMap.load(self.map), self.max_fp)
            felt = None
            if self.memory and recording.robot:
                from learning.pps.memory import load_memory
                from pps_vision.app.pipeline import TrackActivation, check_memory
                from pps_vision.robot.skin import icub_skin

                memory, skin = load_memory(self.memory), icub_skin()
                check_memory(memory, skin, self.memory)
                felt = TrackActivation(recording.robot, skin, memory)
            joints: deque[Array] = deque()  # of the steps that the smoother holds back
            key_frames: list[Image] = []
            every = -(-len(run) // _KEY_FRAMES)
            numbers, reached = PathNumbers(recording.truth), Counter[ReachStatus]()
            columns = TRAJECTORY + REACHABILITY if reach else TRAJECTORY
            with ExitStack() as files:
                film = files.enter_context(VideoFile(folder / "overlay.mp4", recording.fps))
                write_detection = files.enter_context(open_table(folder / "detections.csv", DETECTIONS))
                write_track = files.enter_context(open_table(folder / "trajectory.csv", columns))
                write_forms = files.enter_context(open_forms(folder, self.also, recording.image_size))
                view = write_activation = None
                if felt:
                    taxels = ("stamp_s", *skin.taxel_ids)
                    write_activation = files.enter_context(open_table(folder / ACTIVATION, taxels))
                if self.viewer:
                    from pps_vision.app.report.viewer import VIEW, ViewFile

                    view = files.enter_context(ViewFile(folder / VIEW))

                def steps() -> Iterator[TrackerStep]:
                    """What is known of a pair when it is tracked is written at once."""
                    pairs = tqdm(run.numbered(), total=len(run), desc="track", unit="pair", disable=None)
                    for k, (number, frame, step) in enumerate(pairs):
                        if reach:
                            joints.append(joints_of(frame))
                        skin_now = felt(joints_of(frame), step.track) if felt else None
                        if skin_now and write_activation:
                            write_activation((skin_now[0].stamp_s, *skin_now[0].probability))
                        if view:
                            view.add(frame, step)
                        for seen in step.detections:
                            write_detection(detection_row(number, seen, step.track.status))
                        shown = self.report and k % every == every // 2
                        if (self.video or shown) and recording.rig is not None:
                            skin_shown = (skin_now[1], skin_now[0].probability) if skin_now else ()
                            eyes = recording.rig.view_of(frame)
                            drawn = draw_pair(frame, eyes, step.track, step.detections, *skin_shown)
                            if self.video:
                                film.add(drawn)
                            if shown:
                                key_frames.append(drawn)
                        yield step

                for pair in run.tracked_pairs(run.path(steps(), self.smooth)):
                    numbers.add(pair.track)
                    reachability = reach(joints.popleft(), pair.track) if reach else None
                    if reachability:
                        reached[reachability.status] += 1
                    write_track(trajectory_row(pair.track, reachability))
                    write_forms(pair)
                if view:
                    view.finish(recording.truth)
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
                counts = {status.value: reached[status] for status in ReachStatus}
                summary["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / "summary.json", summary)
            if self.report:
                from pps_vision.app.report.tracking import KEY_FRAMES, write_report

                (folder / KEY_FRAMES).mkdir()
                for k, drawn in enumerate(key_frames):
                    save_jpeg(folder / KEY_FRAMES / f"{k}.jpg", drawn)
                write_report(folder)
        print_skipped(recording.problems)
        print(run.headline(numbers), f"→ {self.out}")
        if diagnosis:
            print(diagnosis)
