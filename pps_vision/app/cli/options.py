"""Options and messages that several commands share."""

import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from pps_vision.errors import InputError
from pps_vision.recordings import MAX_SKEW_S
from tracking import Mode

if TYPE_CHECKING:
    from pps_vision.recordings.recording import Recording
    from pps_vision.robot.robot_setup import RobotSetup


@dataclass(frozen=True)
class SourceOptions:
    """One recording, or any stereo images or videos."""

    rec: Positional[Path | None] = None
    """Recording: an iCub's folder (yarpdatadumper layout), an EuRoC or KITTI folder, a ROS bag, or a video with the
    left image in its left half."""
    left: tuple[str, ...] = ()
    """Left images: a folder, a pattern in quotes such as 'seq/left*.png', or the files themselves; or a video.
    Of a ROS bag: the topic, where its name does not hold "left"."""
    right: tuple[str, ...] = ()
    """Right images, paired with the left ones by stamp, or with --fps by the last number in their names; or a video."""
    calib: tuple[Path, ...] = ()
    """Calibration of OpenCV (one file for all, or left, right and stereo), Kalibr, ROS (left and right), KITTI, EuRoC
    (left and right) or aniposelib; for an iCub's REC without its own icubEyes.ini that file."""
    times: Path | None = None
    """Stamps of the images, a row each: s, "stamp name" (TUM), or EuRoC's CSV in ns."""
    fps: float | None = None
    """Frames per second; required where neither files nor names hold stamps."""
    unit_m: float = 1.0
    """Metres per length unit of the calibration (0.01 if its board was measured in cm)."""
    joints: Path | None = None
    """Offsets to add to the encoders of REC, as `pps-vision joints` writes them."""
    max_skew_s: float = MAX_SKEW_S
    """Left and right images further apart in time are no pair."""

    def open(self) -> "Recording":
        """Open the recording; InputError if it is unusable."""
        from pps_vision.recordings.open import open_recording

        return open_recording(
            **{field.name: getattr(self, field.name) for field in fields(SourceOptions)[1:]}, folder=self.rec
        )


def command_line(name: str, options: object, chosen: "Sequence[Field[Any]] | None" = None) -> str:
    """Return the command line with these options, without defaults; only the `chosen` fields if given."""
    words = ["pps-vision", name]
    for field in chosen or fields(options):  # type: ignore[arg-type]
        value = getattr(options, field.name)
        if value is None or value == field.default:
            continue
        flag = [] if field.name == "rec" else [f"--{field.name.replace('_', '-')}"]
        words += flag if value is True else [*flag, *map(str, value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)


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
    ) -> "Used":
        """Open and use every recording and print skipped rows and images; a failure does not stop the others.

        Raises:
            InputError: There is no recording, or none is usable.
            ExceptionGroup: None is usable, some because of a bug.
        """
        from pps_vision.app.progress import progress
        from pps_vision.recordings.open import open_recording

        if not self.recordings:
            raise InputError(command, "no recording given; expected one folder or more")
        skipped: list[InputError | OSError] = []
        bugs: list[Exception] = []
        for folder in progress(self.recordings, desc=command, unit="recording"):
            try:
                recording = open_recording(
                    folder,
                    calib=[self.calib] if self.calib else (),
                    joints=joints,
                    taxels=self.taxels,
                    max_skew_s=self.max_skew_s,
                    robot=robot,
                )
                try:
                    use(recording)
                finally:
                    print_skipped(recording.problems, recording.warnings)
            except (InputError, OSError) as error:
                skipped.append(error)
                if len(self.recordings) > 1:
                    print_skipped([error])
            except Exception as error:
                error.add_note(f"while using {folder}")
                bugs.append(error)
        used = Used(len(self.recordings) - len(skipped) - len(bugs), bugs)
        if not used.n:
            used.raise_bugs()
            n = len(self.recordings)
            raise skipped[0] if n == 1 else InputError(command, f"none of {n} recordings is usable")
        return used


@dataclass(frozen=True)
class Used:
    """Number of used recordings, and the bugs that prevented others."""

    n: int
    bugs: list[Exception]

    def raise_bugs(self) -> None:
        """Raise the bugs with their tracebacks; call it after the result of the others is written."""
        if self.bugs:
            raise ExceptionGroup("bugs of pps-vision; the recordings are left out", self.bugs)


def print_skipped(problems: Iterable[object], warnings: Iterable[str] = ()) -> None:
    """Print skipped items and warnings on the error stream."""
    for problem in problems:
        print(f"skipped: {problem}", file=sys.stderr)
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
