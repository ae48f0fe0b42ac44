"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
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
        from pps_vision.app.track import track
        from pps_vision.app.versions import versions
        from pps_vision.recordings.exchange import write_forms
        from pps_vision.recordings.outputs import whole_folder, write_json
        from pps_vision.recordings.tables import ACTIVATION, write_activations, write_detections, write_trajectory
        from pps_vision.types import ReachStatus
        from tracking.kalman import KalmanParams
        from tracking.tracker import TrackerParams

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
            detections, steps, joints, key_frames, activations = [], [], [], [], []
            every = -(-len(run) // _KEY_FRAMES)
            with ExitStack() as files:
                film = files.enter_context(VideoFile(folder / "overlay.mp4", recording.fps))
                view = None
                if self.viewer:
                    from pps_vision.app.report.viewer import VIEW, ViewFile

                    view = files.enter_context(ViewFile(folder / VIEW))
                for number, frame, step in tqdm(
                    run.numbered(), total=len(run), desc="track", unit="pair", disable=None
                ):
                    steps.append(replace(step, regions=((), ())))  # their masks would take 8 kB a pair
                    if reach or felt:
                        from pps_vision.app.pipeline import joints_of

                        joints.append(joints_of(frame))
                    skin_now = felt(joints[-1], step.track) if felt else None
                    if skin_now:
                        activations.append(skin_now[0])
                    if view:
                        view.add(frame, step)
                    detections += [(number, seen, step.track.status) for seen in step.detections]
                    shown = self.report and (len(steps) - 1) % every == every // 2
                    if (self.video or shown) and recording.rig is not None:
                        skin_shown = (skin_now[1], skin_now[0].probability) if skin_now else ()
                        eyes = recording.rig.view_of(frame)
                        drawn = draw_pair(frame, eyes, step.track, step.detections, *skin_shown)
                        if self.video:
                            film.add(drawn)
                        if shown:
                            key_frames.append(drawn)
                if view:
                    view.finish(recording.truth)
            tracks = run.path(steps, self.smooth)
            reachability = [reach(q, one) for q, one in zip(joints, tracks, strict=True)] if reach else []
            write_detections(folder / "detections.csv", detections)
            write_trajectory(folder / "trajectory.csv", tracks, reachability)
            if activations:
                write_activations(folder / ACTIVATION, activations)
            if self.also:
                write_forms(folder, self.also, run.tracked_pairs(tracks, steps), recording.image_size)
            diagnosis = run.diagnosis(tracks)
            summary = run.summary(tracks, diagnosis) | {
                "smoothed": self.smooth,
                "joints": self.joints,
                "map": self.map,
                "memory": self.memory,
                "versions": versions(),
                "command": command_line("track", self),
            }
            if reachability:
                found = [reach.status for reach in reachability]
                counts = {status.value: found.count(status) for status in ReachStatus}
                summary["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / "summary.json", summary)
            if self.report:
                from pps_vision.app.report.tracking import KEY_FRAMES, write_report

                (folder / KEY_FRAMES).mkdir()
                for k, drawn in enumerate(key_frames):
                    save_jpeg(folder / KEY_FRAMES / f"{k}.jpg", drawn)
                write_report(folder)
        print_skipped(recording.problems)
        print(run.headline(tracks), f"→ {self.out}")
        if diagnosis:
            print(diagnosis)
