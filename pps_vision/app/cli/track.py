"""`pps-vision track`: a recording, or any stereo images, to a 3D path with its covariance."""

from dataclasses import dataclass
from pathlib import Path

from tyro import MISSING
from tyro.conf import Positional

from pps_vision.app.cli.options import print_skipped
from pps_vision.errors import InputError
from tracking import DEFAULT_ORDER, Mode


@dataclass(frozen=True)
class Track:
    """Follow a moving object (or a green marker) in both eyes and write its 3D path.

    Either a recording folder REC of an iCub (yarpdatadumper layout, as `render` writes it), or
    --left, --right, --calib and --fps for any stereo images; the root frame is then the left camera.
    """

    rec: Positional[Path | None] = None
    """Recording folder."""
    out: Path = MISSING
    """Folder for detections.csv, trajectory.csv, summary.json (and overlay.mp4)."""
    left: tuple[str, ...] = ()
    """Left images: a pattern in quotes such as 'seq/left*.png', or the files themselves."""
    right: tuple[str, ...] = ()
    """Right images, paired with the left ones by the last number in their names."""
    calib: tuple[Path, ...] = ()
    """Calibration: OpenCV files (one for all, or left, right and stereo), or icubEyes.ini for a REC without its own."""
    joints: Path | None = None
    """What to add to the encoders of REC, as `pps-vision joints` writes it."""
    map: Path | None = None
    """Reachable-space map of `pps-vision reach train`: trajectory.csv then also holds, for every frame of REC, the gaze
    that fixates the object (gaze_yaw_deg, gaze_pitch_deg, gaze_vergence_deg) and whether the hand can reach it
    (reach_probability, reach_degree, reach_status: reachable, unreachable, not fixated by any gaze the map knows, or
    unknown without a track)."""
    max_fp: float = 1e-3
    """Share of unreachable places that --map may call reachable."""
    fps: float | None = None
    """Frames per second of --left/--right; required with them."""
    unit_m: float = 1.0
    """Metres per length unit of the OpenCV calibration (0.01 if its board was measured in cm)."""
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
    the smoothed path; the video shows the path as it was known then."""
    max_skew_s: float = 0.02
    """Left and right images further apart in time are no pair."""
    video: bool = False
    """Also write overlay.mp4."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Read, track, and write everything at once; what had to be skipped is printed."""
        from tqdm import tqdm

        from learning.reach.map import ReachableMap
        from learning.reach.track_reachability import TrackReachability
        from pps_vision.app.pipeline import joints_of
        from pps_vision.app.report.overlay import VideoFile, draw_pair
        from pps_vision.app.track import track
        from pps_vision.recordings.open import open_recording
        from pps_vision.recordings.outputs import whole_folder, write_json
        from pps_vision.recordings.tables import write_detections, write_trajectory
        from pps_vision.types import ReachStatus
        from tracking.kalman import KalmanParams
        from tracking.tracker import TrackerParams

        if self.map and self.rec is None:
            raise InputError("track", f"--map {self.map} with --left and --right; expected it with REC")
        with whole_folder(self.out) as folder:
            recording = open_recording(
                self.rec,
                left=self.left,
                right=self.right,
                calib=self.calib,
                fps=self.fps,
                unit_m=self.unit_m,
                joints=self.joints,
                max_skew_s=self.max_skew_s,
            )
            params = TrackerParams(mode=self.mode, kalman=KalmanParams.of_order(self.order))
            run = track(recording, params=params, max_error_mm=self.max_error_mm, device=self.device, seed=self.seed)
            reach = None
            if self.map and recording.robot:
                reach = TrackReachability(recording.robot, ReachableMap.load(self.map), self.max_fp)
            detections, steps, joints = [], [], []
            with VideoFile(folder / "overlay.mp4", recording.fps) as film:
                for number, frame, step in tqdm(
                    run.numbered(), total=len(run), desc="track", unit="pair", disable=None
                ):
                    steps.append(step)
                    if reach:
                        joints.append(joints_of(frame))
                    detections += [(number, seen, step.track.status) for seen in step.detections]
                    if self.video and recording.rig is not None:
                        film.add(draw_pair(frame, recording.rig.view_of(frame), step.track, step.detections))
            tracks = run.path(steps, self.smooth)
            reachability = [reach(q, one) for q, one in zip(joints, tracks, strict=True)] if reach else []
            write_detections(folder / "detections.csv", detections)
            write_trajectory(folder / "trajectory.csv", tracks, reachability)
            diagnosis = run.diagnosis(tracks)
            summary = run.summary(tracks, diagnosis) | {"smoothed": self.smooth, "joints": self.joints, "map": self.map}
            if reachability:
                found = [reach.status for reach in reachability]
                counts = {status.value: found.count(status) for status in ReachStatus}
                summary["reach"] = {"max_fp": self.max_fp, **counts}
            write_json(folder / "summary.json", summary)
        print_skipped(recording.problems)
        print(run.headline(tracks), f"→ {self.out}")
        if diagnosis:
            print(diagnosis)
