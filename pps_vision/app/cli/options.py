"""Options and messages that several commands share."""

import shlex
import sys
from collections.abc import Callable, Iterable
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from pps_vision.errors import InputError
from pps_vision.recordings import MAX_SKEW_S, Clock, Form
from pps_vision.recordings.source import SourceOptions
from tracking import DEFAULT_OBJECTS, DEFAULT_ORDER, Mode

if TYPE_CHECKING:
    from pps_vision.recordings.recording import Recording
    from pps_vision.robot.robot_setup import RobotSetup


@dataclass(frozen=True)
class RecordingSource(SourceOptions):
    """One recording, or any stereo images or videos."""

    rec: Positional[Path | None] = None
    """Recording: an iCub's folder (yarpdatadumper layout), an EuRoC or KITTI folder, a ROS bag, or a video with the
    left image in its left half."""

    def open(self) -> "Recording":
        """Open the recording; InputError if it is unusable."""
        from pps_vision.recordings.open import open_recording

        options: Any = {field.name: getattr(self, field.name) for field in fields(SourceOptions)}
        return open_recording(self.rec, **options)


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """Options of tracking, and of its output."""

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
    clock: Clock = "stamps"
    """auto: first estimate the delays of the right camera's stamps and of the joints, as `clock` does, and correct
    them."""
    mode: Mode = "generic"
    """generic: any moving object; marker: a green marker (faster)."""
    hue: float | None = None
    """Hue of a marker, degrees (0 red, 120 green, 240 blue); implies --mode marker."""
    init_left: tuple[float, float, float, float] | None = None
    """X Y W H of the object in the first left image, top-left corner and size, pixels: follow this object alone; with
    --init-right."""
    init_right: tuple[float, float, float, float] | None = None
    """The same in the first right image."""
    order: int = DEFAULT_ORDER
    """Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk."""
    reduction: int = 1
    """Average each block of this many pixels a side to one before searching: about half the time in large images at 2,
    for two to three times the error."""
    objects: int = DEFAULT_OBJECTS
    """Largest number of objects followed at a time, up to 4.  The attended object comes first: the one that most
    activates the skin by --memory, else the soonest to reach the cameras, else the nearest that moves."""
    one: bool = False
    """Follow one object, as --objects 1: in less time where hands or people move too."""
    device: str | None = None
    """Process batches of frames with torch on this device (cpu, cuda, cuda:1), for long recordings; default: frame by
    frame, without torch."""
    smooth: bool = False
    """Smooth the path with later measurements (RTS smoothing): trajectory.csv and the errors are those of
    the smoothed path; video, view and activation.csv show the causal track."""
    also: tuple[Form, ...] = ()
    """Also write the forms of other tools: tum (evo), anipose (movement), mot and coco (boxes of all objects in the
    images), ros2 (a bag; extra `ros`)."""
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


_POSITIONAL = ("rec", "recordings")  # written first: an option with several values would take them


def words_of(options: object, chosen: "Iterable[Field[Any]]") -> list[str]:
    """Return the chosen options as words of a command line, without defaults."""
    words: list[str] = []
    for field in sorted(chosen, key=lambda field: field.name not in _POSITIONAL):
        value = getattr(options, field.name)
        if value is None or value == field.default:
            continue
        flag = [] if field.name in _POSITIONAL else [f"--{field.name.replace('_', '-')}"]
        words += flag if value is True else [*flag, *map(str, value if isinstance(value, tuple) else (value,))]
    return words


def command_line(name: str, options: object, chosen: "Iterable[Field[Any]] | None" = None) -> str:
    """Return the command line with these options, without defaults; only the `chosen` fields if given."""
    return shlex.join(["pps-vision", name, *words_of(options, chosen or fields(options))])  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """The robot; by default the iCub."""

    robot: Path | None = None
    """robot.toml of another robot: its URDF, skin, cameras and joints; default: the iCub."""
    urdf: Path | None = None
    """URDF instead of the one that --robot names."""
    skin: Path | None = None
    """Skin instead of the robot's: a table part,frame,taxel,x_m,y_m,z_m,nx,ny,nz (.csv), or the iCub's own .ini."""

    def setup(self) -> "RobotSetup":
        """Read the robot; InputError for files that do not describe a robot."""
        from pps_vision.recordings.robot_file import robot_setup

        return robot_setup(self.robot, self.urdf, self.skin)

    @property
    def files(self) -> tuple[Path | None, ...]:
        """Input files, which must not be overwritten."""
        return self.robot, self.urdf, self.skin


@dataclass(frozen=True)
class RecordingOptions:
    """Recordings of a robot whose skin is touched, with the options to read and track them."""

    recordings: Positional[tuple[Path, ...]]
    """Recording folders REC …, used in this order."""
    out: Path
    """File to write."""
    calib: Path | None = None
    """icubEyes.ini for recordings without their own."""
    taxels: Path | None = None
    """The robot's taxels*.ini, for recordings of its own skin events: which virtual taxel each physical one is of."""
    mode: Mode = "generic"
    """How the object is tracked: generic (whatever moves) or marker (a green marker)."""
    max_skew_s: float = MAX_SKEW_S
    """Largest difference of the stamps of a pair of left and right image."""
    seed: int = 0
    """Seed of the particle filter."""

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """Input files, which must not be overwritten."""
        return (*self.recordings, self.calib, self.taxels)

    def use_each(
        self,
        command: str,
        use: "Callable[[Recording], None]",
        joints: Path | None = None,
        robot: "RobotSetup | None" = None,
    ) -> int:
        """Open and use every recording and print skipped rows and images; bad input does not stop the others.

        Returns the number of used recordings; InputError if there is none.
        """
        from pps_vision.app.progress import progress
        from pps_vision.recordings.open import open_recording

        if not self.recordings:
            raise InputError(command, "no recording given; expected one folder or more")
        skipped: list[InputError | OSError] = []
        for folder in progress(self.recordings, desc=command, unit="recording"):
            try:
                calib = self.calib or ()
                recording = open_recording(
                    folder, calib=calib, joints=joints, taxels=self.taxels, max_skew_s=self.max_skew_s, robot=robot
                )
                try:
                    use(recording)
                finally:
                    print_skipped(recording.problems, recording.warnings)
            except (InputError, OSError) as error:
                skipped.append(error)
                if len(self.recordings) > 1:
                    print_skipped([error])
        n = len(self.recordings)
        if len(skipped) == n:
            raise skipped[0] if n == 1 else InputError(command, f"none of {n} recordings is usable")
        return n - len(skipped)


def print_skipped(problems: Iterable[object], warnings: Iterable[str] = ()) -> None:
    """Print skipped items and warnings on the error stream."""
    for problem in problems:
        print(f"skipped: {problem}", file=sys.stderr)
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
