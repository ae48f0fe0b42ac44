"""A robot of one's own: robot.toml, which names its URDF, skin, cameras and joints.

| key | holds |
|---|---|
| `urdf` | file, from the folder of robot.toml |
| `skin` | file or files: tables of part,frame,taxel,x_m,y_m,z_m,nx,ny,nz, or the iCub's own (`read_skin`) |
| `root` | link that is the root frame; default: the URDF's own |
| `left_eye`, `right_eye` | link with the axes of a camera (z out of it, x right, y down), or `{link, xyz_m, rpy_deg}` |
| `cameras` | intrinsics in the form of icubEyes.ini; default: the iCub's |
| `left_arm`, `right_arm` | joints from shoulder to wrist, of one arm or both |
| `left_palm`, `right_palm` | link at the end of each arm |
| `gaze_joints` | neck yaw, neck pitch, eyes tilt, left pan, right pan; default: none, the cameras do not turn |
| `torso` | yaw and pitch of the torso; default: none |
| `[home_deg]` | joint = angle at rest; default: 0, or the nearest limit |
| `[margins]` | skin part = factor of its safety margin, such as 2 for the hand; default: 1 |
| `[ports]` | port = joints in the order of its encoders (degrees), "-": none; default: `joints`, all of the URDF |

A skin's table (.csv) has a row for each taxel, its position and outward normal in a frame of the robot.  The iCub's
file (.ini, .txt) has `name`, `taxel2Repr` (the virtual taxel of each physical one, −1 none) and, below [calibration], a
row x y z nx ny nz for each physical taxel; its frame is called as the part, or PART_skin.  Rows without a normal are
left out, with a warning that counts them.
"""

import re
import tomllib
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Never

import numpy as np
import pinocchio as pin

from pps_vision.errors import InputError, first_line
from pps_vision.files import read_bytes
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.recordings.tables import read_table
from pps_vision.recordings.taxels_ini import OUR_NAMES
from pps_vision.recordings.text import finite, read_lines, whole
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE, icub_setup
from pps_vision.robot.model import FrameNames, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import Skin, SkinPart
from pps_vision.robot.urdf import names_in
from pps_vision.types import Array

_FARTHEST_M = 5.0  # of a taxel from its frame: farther ones are in mm
_TAXEL = ("part", "frame", "taxel", "x_m", "y_m", "z_m", "nx", "ny", "nz")

Row = tuple[int, str, str, int, list[float]]
"""Line, part, frame, taxel, position and normal."""
_JOINTS = ("gaze_joints", "torso", "left_arm", "right_arm")
_LINKS = ("root", "left_palm", "right_palm")
_EYES = ("left_eye", "right_eye")


def robot_setup(file: Path | None = None, urdf: Path | None = None, skin: Path | None = None) -> RobotSetup:
    """The robot that `file` (robot.toml) describes, by default the iCub, with another URDF or skin if given;
    InputError names the file, the line and the value that cannot be used."""
    if file is not None:
        return read_robot(file, urdf, skin)
    if urdf is not None:
        raise InputError("robot", f"--urdf {urdf}; expected --robot robot.toml too, which says what its joints are")
    setup = icub_setup()
    return setup if skin is None else replace(setup, skin=read_skin((skin,), setup.robot))


def read_robot(file: Path, urdf: Path | None = None, skin: Path | None = None) -> RobotSetup:
    """The robot that a robot.toml describes; `urdf` and `skin` replace the files that it names."""
    toml = _Toml.read(file)
    urdf_file = urdf or file.parent / toml.word("urdf")
    eyes = {eye: toml.eye(eye) for eye in _EYES}
    mounted = {eye: pose for eye, (_, pose) in eyes.items() if pose is not None}
    joints = {key: toml.words(key, toml.values.get(key, [])) for key in _JOINTS}
    if len(joints["gaze_joints"]) not in (0, 5):
        toml.refuse("gaze_joints", "neck yaw, neck pitch, eyes tilt, left pan and right pan, or none")
    links = {key: toml.word(key) for key in _LINKS}
    frames: Any = {**{eye: frame for eye, (frame, _) in eyes.items()}, **joints}
    names = FrameNames(palms=(links["left_palm"], links["right_palm"]), index_tips=("", ""), **frames)
    link_names, joint_names = names_in(urdf_file)
    for key in _JOINTS:
        toml.check_known(key, joints[key], joint_names)
    for key in (*_LINKS, *_EYES):
        link = links[key] if key in links else mounted[key][0] if key in mounted else eyes[key][0]
        toml.check_known(key, [link] if link else [], link_names)
    robot = Robot(urdf_file, names, links["root"] or None, mounted)
    for side in ("left", "right"):
        if bool(names.arm(side)) != bool(links[f"{side}_palm"]):
            key = f"{side}_arm" if names.arm(side) else f"{side}_palm"
            toml.refuse(key, f"both {side}_arm and {side}_palm, or neither")
    skin_files = (skin,) if skin else toml.folder_files("skin")
    cameras = toml.folder_files("cameras") if "cameras" in toml.values else ()
    left, right = read_icub_eyes(cameras[0]) if cameras else (LEFT_EYE, RIGHT_EYE)
    rig = StereoRig(left, right, robot.eye_poses)
    ports = toml.ports(robot)
    return RobotSetup(robot, rig, toml.margins(read_skin(skin_files, robot)), toml.home(robot), ports, tuple(ports))


@dataclass(frozen=True)
class _Toml:
    """The values of a robot.toml, and their lines for error messages."""

    file: Path
    lines: list[str]
    values: dict[str, Any]

    @classmethod
    def read(cls, file: Path) -> "_Toml":
        text = read_bytes(file, "a robot.toml").decode("utf-8-sig", errors="replace")
        try:
            values = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            at = re.search(r"at line (\d+)", str(error))
            reason = f"cannot be read as TOML: {first_line(error)}"
            raise InputError(file, reason, int(at[1]) if at else None) from error
        toml = cls(file, text.split("\n"), values)
        valid_keys = ("urdf", "skin", "cameras", *_JOINTS, *_LINKS, *_EYES, "home_deg", "margins", "ports")
        for key in values:
            if key not in valid_keys:
                toml.refuse(key, f"one of {', '.join(valid_keys)}", "unknown key")
        required = ("urdf", "skin", *_EYES)
        if missing := [key for key in required if key not in values]:
            raise InputError(file, f"no {missing[0]}; expected {', '.join(required)}")
        return toml

    def refuse(self, key: str, expected: str, reason: str | None = None) -> Never:
        """Raise InputError for a key, by the line in which it first stands."""
        pattern = re.compile(rf"\s*\[?\s*[\"']?{re.escape(key)}[\"']?\s*[\]=]")
        line = next((n for n, text in enumerate(self.lines, start=1) if pattern.match(text)), None)
        shown = f"{key} {self.values[key]!r}"[:80] if reason is None else f"{reason} {key}"
        raise InputError(self.file, f"{shown}; expected {expected}", line)

    def word(self, key: str) -> str:
        value = self.values.get(key, "")
        return value if isinstance(value, str) else self.refuse(key, "a name in quotes")

    def words(self, key: str, value: object) -> tuple[str, ...]:
        if not isinstance(value, list) or not all(isinstance(word, str) for word in value):
            self.refuse(key, "a list of names in quotes", f"no list of names: {value!r} of")
        return tuple(value)

    def folder_files(self, key: str) -> tuple[Path, ...]:
        value = self.values[key]
        words = [value] if isinstance(value, str) else value
        return tuple(self.file.parent / word for word in self.words(key, words))

    def eye(self, key: str) -> tuple[str, tuple[str, Array] | None]:
        """The name of a camera's frame, and, for one that is mounted on a link, that link and the pose there."""
        value = self.values[key]
        if isinstance(value, str):
            return value, None
        expected = "a link, or {link = ..., xyz_m = [x, y, z], rpy_deg = [r, p, y]}"
        if not isinstance(value, dict) or not {"link"} <= set(value) <= {"link", "xyz_m", "rpy_deg"}:
            self.refuse(key, expected)
        try:
            xyz, rpy = (np.array(value.get(part, (0, 0, 0)), dtype=float) for part in ("xyz_m", "rpy_deg"))
        except (ValueError, TypeError):
            self.refuse(key, expected)
        if xyz.shape != (3,) or rpy.shape != (3,) or not np.isfinite([xyz, rpy]).all():
            self.refuse(key, expected)
        return key, (str(value["link"]), pin.SE3(pin.rpy.rpyToMatrix(np.deg2rad(rpy)), xyz).homogeneous)

    def check_known(
        self, key: str, names: Iterable[str], valid: Iterable[str], expected: str = "some", where: str = "in"
    ) -> None:
        for name in names:
            if name not in valid:
                self.refuse(key, f"{expected} of {', '.join(valid)}", f"unknown {name!r} {where}")

    def table(self, key: str) -> dict[str, Any]:
        value = self.values.get(key, {})
        return value if isinstance(value, dict) else self.refuse(key, "a table")

    def home(self, robot: Robot) -> Array:
        """(n_joints,) rad, within the limits."""
        q = np.zeros(robot.n_joints)
        for joint, angle in self.table("home_deg").items():
            if joint not in robot.joint_names:
                self.refuse(joint, f"one of {', '.join(robot.joint_names)}", "unknown joint")
            index = robot.joint_names.index(joint)
            low = np.rad2deg(robot.lower_rad[index])
            high = np.rad2deg(robot.upper_rad[index])
            if isinstance(angle, bool) or not isinstance(angle, int | float) or not low <= angle <= high:
                self.refuse(joint, f"degrees from {low:.4g} to {high:.4g}", f"home_deg {angle!r} of")
            q[index] = np.deg2rad(angle)
        return robot.clamp(q)

    def margins(self, skin: Skin) -> Skin:
        """The skin with its parts' safety margins."""
        margins = self.table("margins")
        self.check_known("margins", margins, [part.name for part in skin.parts], "skin parts")
        for part, factor in margins.items():
            if isinstance(factor, bool) or not isinstance(factor, int | float) or not 0 < factor < np.inf:
                self.refuse(part, "a factor above 0", f"margin {factor!r} of")
        return Skin(tuple(replace(part, margin=float(margins.get(part.name, 1.0))) for part in skin.parts))

    def ports(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        ports = {port: self.words(port, names) for port, names in self.table("ports").items()}
        valid = (*robot.joint_names, "-", *(("version", "vergence") if robot.names.gaze_joints else ()))
        for port, names in ports.items():
            self.check_known(port, names, valid, "joints", "in port")
        return ports or {"joints": robot.joint_names}


def read_skin(files: Sequence[Path], robot: Robot) -> Skin:
    """The skin of a robot from one file or several.  InputError where a file cannot be read, or a row has no known
    frame, no new taxel, or no normal."""
    parts: dict[tuple[str, str], list[Row]] = {}
    taxels_read: set[tuple[str, int]] = set()
    for file in files:
        for row in _skin_table(file) if file.suffix.lower() == ".csv" else _icub_part(file):
            line, part, frame, taxel, values = row
            if file.suffix.lower() != ".csv" and f"{part}_skin" in robot.frame_ids:
                frame = f"{part}_skin"
            if not part.isidentifier():
                raise InputError(file, f"part {part!r}; expected a name of letters, digits and _", line)
            if frame not in robot.frame_ids:
                raise InputError(file, f"frame {frame!r}; expected one of {', '.join(robot.frame_ids)}", line)
            if (part, taxel) in taxels_read or taxel < 0:
                raise InputError(file, f"taxel {part}:{taxel}; expected each number from 0 once", line)
            if not np.linalg.norm(values[3:]) > 0.5:
                raise InputError(file, f"normal {values[3:]}; expected one of length 1", line)
            if np.linalg.norm(values[:3]) > _FARTHEST_M:
                expected = f"metres, at most {_FARTHEST_M:g} from its frame"
                raise InputError(file, f"taxel {part}:{taxel} at {values[:3]}; expected {expected}", line)
            taxels_read.add((part, taxel))
            parts.setdefault((part, frame), []).append((line, part, frame, taxel, values))
    names = [part for part, _ in parts]
    if not parts or len(set(names)) < len(names):
        reason = "no taxel" if not parts else f"part {max(names, key=names.count)} in several frames"
        raise InputError(files[0] if files else "skin", f"{reason}; expected taxels, those of a part in one frame")
    return Skin(tuple(_part(*names, rows) for names, rows in parts.items()))


def _part(name: str, frame: str, rows: list[Row]) -> SkinPart:
    values = np.array([row[-1] for row in rows])
    normals = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return SkinPart(name, frame, tuple(row[3] for row in rows), values[:, :3], normals)


def _skin_table(file: Path) -> list[Row]:
    rows = []
    for line, (part, frame, taxel, *numbers) in read_table(file, _TAXEL):
        try:
            rows.append((line, part, frame, whole(taxel), [finite(word) for word in numbers]))
        except ValueError as error:
            raise InputError(file, f"{first_line(error)}; expected {','.join(_TAXEL)}", line) from error
    return rows


def _icub_part(file: Path) -> list[Row]:
    """The virtual taxels of the iCub's file, each where its representative is."""
    part = ""
    representatives = None
    physical = []
    calibrated = False
    for line, text in enumerate(read_lines(file, "a skin part's calibration"), start=1):
        key, value = (*text.split(maxsplit=1), "", "")[:2] if not calibrated else ("", text)
        try:
            if calibrated and text.split():
                numbers = [finite(word) for word in text.split()[:6]]
                if len(numbers) < 6:
                    raise ValueError(f"{len(numbers)} numbers")
                physical.append((line, numbers))
            elif key == "name":
                part = OUR_NAMES.get(value.strip(), value.strip())
            elif key == "taxel2Repr":
                representatives = [whole(word) for word in value.strip(" ()").split()]
        except ValueError as error:
            raise InputError(file, f"{first_line(error)}; expected x y z nx ny nz, or whole numbers", line) from error
        calibrated = calibrated or key == "[calibration]"
    if not part or not physical:
        raise InputError(file, f"{'no name' if not part else 'no taxel'}; expected name and rows below [calibration]")
    if without := sum(not any(numbers[3:]) for _, numbers in physical):
        warnings.warn(f"{file}: {without} of {len(physical)} rows without a normal are left out", stacklevel=2)
    ids = range(len(physical)) if representatives is None else sorted({i for i in representatives if i >= 0})
    return [
        (physical[i][0], part, part, i, physical[i][1]) for i in ids if i < len(physical) and any(physical[i][1][3:])
    ]
