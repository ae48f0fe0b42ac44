"""Recordings of yarpdatadumper: two image ports, joint ports and skin, each a folder with its data.log.

Images are files that the log names (its types image, image_jpg and image_png), or frames of one video beside it (type
video), whose rows name "frame_00000000" and so on.

A row of the skin port is "index stamp touched touched …".  We write the touched virtual taxels by name, "part:id".  The
robot writes a contact as ((number, body part, link, skin part), centre of pressure, force, moment, geometric centre,
normal, (taxels), pressure), where vectors are in the link's frame and taxels are physical ones.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.recording import Pair, Recording, Touch, pair_by_stamp, usual_size
from pps_vision.recordings.source import Source
from pps_vision.recordings.tables import read_truth
from pps_vision.recordings.taxels_ini import read_taxels, representatives
from pps_vision.recordings.text import finite, first_row, whole
from pps_vision.recordings.video import Video, VideoFrame
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.recordings.yarp_text import parse_lists, parse_numbers, read_log
from pps_vision.types import Array

if TYPE_CHECKING:
    from pps_vision.robot.robot_setup import RobotSetup

FORMAT = "a yarpdatadumper recording, folders with a data.log each"
HAS_STAMPS = True
IS_ROBOT = True
MAX_JOINT_GAP_S = 0.1  # from an image to its nearest sample; between two samples twice that is bridged
MAX_BEYOND_S = 0.025  # from an image to the end of a log: a head moves on
_IMAGE_SUFFIXES = (".ppm", ".pgm", ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_DEPTH_SUFFIXES = (".float", ".floatzip")
_VIDEOS = ("video.mkv", "video.avi")
_FRAME = re.compile(r"frame_([0-9]{8,9})", re.ASCII)
_STAMP_RESOLUTION_S = 1e-6  # resolution of the digits in a log, and of a double in seconds since 1970
SKIN_PARTS = {
    **{1: "left_palm", 2: "left_forearm", 3: "left_upper_arm"},
    **{4: "right_palm", 5: "right_forearm", 6: "right_upper_arm", 7: "torso"},
}
"""The robot's numbers of the skin parts that have virtual taxels here."""
_MOST_FOLDERS = 1000
_LARGEST_DEG = 1e4  # no joint; keeps interpolation finite


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    return source.folder is not None and any(_logs(source.folder))


def open_source(source: Source) -> Recording:
    """Open `source.folder`: pairs of images with the joints at each image's stamp.

    Ports are found by what their folders are called, wherever they lie.  A joint port that was not recorded reads 0;
    the iCub's head, and all ports of another robot, must be there.  Bad rows, unpaired images and images without joints
    go to `problems`.  InputError where no frame remains, or a log, the calibration or another file cannot be read at
    all.
    """
    folder = Path(str(source.folder))
    problems = list[Problem]()
    if len(source.calib) > 1:
        raise InputError("recording", f"calib has {len(source.calib)} files; expected one icubEyes.ini with REC")
    setup = source.robot or _icub(folder)
    robot = setup.robot
    virtual = representatives(read_taxels(source.taxels)) if source.taxels else None
    ports = find_ports(folder, tuple(setup.ports))
    sides = ("left", "right")
    if missing := [port for port in (*sides, *setup.required) if port not in ports]:
        port = missing[0]
        if port in sides:
            _refuse_depth(folder, port)
        kind = f"{port} images" if port in sides else "joints" if port == "joints" else f"{port} joints"
        raise InputError(folder, f"no {kind}; expected a folder '{port}' with a data.log")
    names = {port: joints for port, joints in setup.ports.items() if port in ports}
    joints = {port: _read_joints(ports[port], len(names[port]), problems) for port in names}
    touches = read_touches(ports["skin"], virtual, problems) if "skin" in ports else ()
    eyes = [_read_images(ports[side], problems) for side in ("left", "right")]
    pairs = pair_by_stamp(eyes[0], eyes[1], source.max_skew_s, problems)
    posed = with_joints(pairs, joints, problems, setup)
    image_size = usual_size(folder, posed, problems)
    own = folder / "icubEyes.ini"
    truth = folder / "truth.csv"
    eyes_file = source.calib[0] if source.calib else own if os.path.lexists(own) else None
    return Recording(
        name=str(folder),
        pairs=posed,
        image_size=image_size,
        problems=problems,
        robot=robot,
        rig=StereoRig(*read_icub_eyes(eyes_file, image_size), robot.eye_poses) if eyes_file else None,
        touches=touches,
        truth=read_truth(truth, problems) if os.path.lexists(truth) else (),
        calibration_at="icubEyes.ini there or by --calib",
        warnings=("no joints of the torso: taken as 0",) * ("torso" in setup.ports.keys() - ports.keys()),
    )


def _icub(folder: Path) -> "RobotSetup":
    """The iCub, whose kinematics need Pinocchio; InputError without it, as in an environment for tracking only."""
    try:
        from pps_vision.robot.icub import icub_setup
    except ModuleNotFoundError as error:
        reason = f"is of a robot, and {error.name} is not installed"
        raise InputError(folder, f"{reason}; expected the whole of pps-vision's packages") from error
    return icub_setup()


def _read_images(log: Path, problems: list[Problem]) -> list[ImageFile]:
    """The images a log names; InputError if it names none, or one that is not within its folder, or frames of a video
    that is not there."""
    files: list[ImageFile] = []
    video: Video | None = None
    for row in read_log(log, None, problems, distinct_stamps=True):
        if not row.words or len(row.words) > 2:  # the second is the pixel code, "[rgb]"
            reason = f"{len(row.words)} words; expected index, stamp and the name of an image"
            problems.append(Problem(ProblemKind.ROW, log, row.line, reason))
            continue
        if frame := _FRAME.fullmatch(row.words[0]):
            video = video or _video(log)
            index = int(frame[1])
            if index < len(video.pts):
                files.append(VideoFrame(video.path, row.stamp_s, log=log, line=row.line, video=video, index=index))
            else:
                reason = f"{row.words[0]} of {len(video.pts)} frames in {video.path.name}"
                problems.append(Problem(ProblemKind.IMAGE, log, row.line, f"{reason}; expected a frame for each row"))
            continue
        name = PurePath(row.words[0])
        if name.is_absolute() or ".." in name.parts:
            raise InputError(log, f"file name '{name}' points outside; expected a file beside the log", row.line)
        files.append(ImageFile(log.parent / name, row.stamp_s, log=log, line=row.line))
    if not files:
        why = f"; {problems[-1]}" if problems and problems[-1].file == log else ""
        raise InputError(log, f"names no image; expected rows of index, stamp and the name of an image{why}")
    return files


def _video(log: Path) -> Video:
    """The video beside a log that names frames; InputError without one."""
    for name in _VIDEOS:
        if (file := log.with_name(name)).exists():
            return Video(file)
    raise InputError(log, f"names frames of a video; expected {' or '.join(_VIDEOS)} beside it")


def _refuse_depth(folder: Path, side: str) -> None:
    """InputError where an eye has distances instead of images (the dumper's types depth and depth_compressed)."""
    for log in sorted(_logs(folder)):
        is_depth = _type(log).startswith("Depth") or _names(log, _DEPTH_SUFFIXES)
        if is_depth and side in log.parent.relative_to(folder).as_posix().lower():
            raise InputError(log, f"holds distances, no images; expected {side} images of type image or video")


def _read_joints(log: Path, n_joints: int, problems: list[Problem]) -> tuple[Array, Array]:
    """Stamps (n,) and encoder readings (n, n_joints) in degrees."""
    stamps = []
    samples = []
    for row in read_log(log, n_joints, problems):
        sample = np.array(row.words, dtype=float)
        if np.all(np.abs(sample) < _LARGEST_DEG):
            stamps.append(row.stamp_s)
            samples.append(sample)
        else:
            reason = f"joint reads {row.words[int(np.argmin(np.abs(sample) < _LARGEST_DEG))]}"
            problems.append(Problem(ProblemKind.JOINTS, log, row.line, f"{reason}; expected degrees"))
    if not stamps:
        raise InputError(log, f"no readable sample; expected rows of index, stamp and {n_joints} joints in degrees")
    return np.array(stamps), np.array(samples)


def with_joints(
    pairs: tuple[Pair, ...],
    joints: dict[str, tuple[Array, Array]],
    problems: list[Problem],
    setup: "RobotSetup",
) -> tuple[Pair, ...]:
    """Every pair with the joints at each eye's stamp; pairs outside the joint logs are noted and left out."""
    posed = []
    for pair in pairs:
        missing = [(file, port) for file in pair for port, log in joints.items() if not _covers(log[0], file.stamp_s)]
        for file, port in missing:
            expected = f"samples around its stamp, within {MAX_JOINT_GAP_S} s"
            reason = f"{file.path.name} has no {port} joints; expected {expected}"
            problems.append(Problem(ProblemKind.JOINTS, file.cited, file.line, reason))
        if not missing:
            readings = [{port: interpolated(*log, file.stamp_s) for port, log in joints.items()} for file in pair]
            q_left, q_right = map(setup.configuration, readings)
            posed.append((replace(pair[0], joints_rad=q_left), replace(pair[1], joints_rad=q_right)))
    return tuple(posed)


def _covers(stamps: Array, stamp_s: float) -> bool:
    """Whether a sample is near, and those on both sides are close enough together to go between them."""
    earlier = stamps[max(int(np.searchsorted(stamps, stamp_s, "right")) - 1, 0)]
    after = stamps[min(int(np.searchsorted(stamps, stamp_s, "left")), len(stamps) - 1)]  # itself if a sample is there
    nearest_s = min(abs(stamp_s - earlier), abs(after - stamp_s)) - _STAMP_RESOLUTION_S
    between_s = after - earlier - _STAMP_RESOLUTION_S
    most_s = MAX_JOINT_GAP_S if stamps[0] <= stamp_s <= stamps[-1] else MAX_BEYOND_S
    return bool(nearest_s <= most_s and between_s <= 2 * MAX_JOINT_GAP_S)


def interpolated(stamps: Array, samples: Array, stamp_s: float) -> Array:
    """Encoders at one stamp, linear between samples, the end's own value beyond the ends."""
    last = int(np.clip(np.searchsorted(stamps, stamp_s), 1, max(len(stamps) - 1, 1)))
    around = slice(last - 1, last + 1)
    return np.array([np.interp(stamp_s, stamps[around], column) for column in samples[around].T])


def find_ports(folder: Path, joint_ports: Sequence[str]) -> dict[str, Path]:
    """The data.log of every port: "left" and "right" (images), joints, skin.

    Joints and skin lie in a folder called so (`rightArm`, `right_arm/state:o`), images below one
    whose name holds left or right.  InputError if two logs claim one port.
    """
    ports: dict[str, Path] = {}
    logs = sorted(_logs(folder))
    port_names = {_plain(port): port for port in (*joint_ports, "skin")}
    for log in logs:
        port = _port(log.parent.relative_to(folder), log, port_names)
        if port in ports:
            raise InputError(log, f"a second log for {port}; expected one, and {ports[port]} is there")
        if port is not None:
            ports[port] = log
    for log in logs:
        if log.parent.name in ("left", "right") and not first_row(log):
            ports.setdefault(log.parent.name, log)  # it names no image, which its reader reports
    return ports


def _port(place: Path, log: Path, port_names: dict[str, str]) -> str | None:
    """Which port a log belongs to, None if to one that is not read here."""
    if _holds_images(log):
        name = place.as_posix().lower()
        side = max(("left", "right"), key=name.rfind)
        return side if side in name else None
    return next((port_names[part] for part in map(_plain, place.parts) if part in port_names), None)


def _plain(name: str) -> str:
    return name.lower().replace("_", "")


def _holds_images(log: Path) -> bool:
    """By the type in info.log, or else by the file name in the first row."""
    if kind := _type(log):
        return kind.startswith("Image")
    return _names(log, _IMAGE_SUFFIXES) or any(map(_FRAME.fullmatch, first_row(log).split()))


def _names(log: Path, suffixes: tuple[str, ...]) -> bool:
    """Whether the first row of a log names a file with one of the suffixes."""
    return any(word.lower().endswith(suffixes) for word in first_row(log).split())


def _type(log: Path) -> str:
    """The type stated in the info.log beside a log, "Image:ppm;" for instance; "" without one."""
    kind = first_row(log.with_name("info.log"))
    return kind.removeprefix("Type:").strip() if kind.startswith("Type:") else ""


def _logs(folder: Path) -> Iterator[Path]:
    """Every data.log below a folder; linked folders are followed, each once.  InputError for a whole disk."""
    visited = {os.path.realpath(folder)}
    for k, (place, folders, files) in enumerate(os.walk(folder, followlinks=True)):
        if k == _MOST_FOLDERS:
            raise InputError(folder, f"holds more than {_MOST_FOLDERS} folders; expected the folder of one recording")
        if "data.log" in files or "data.log" in folders:  # a folder of that name is refused by its reader
            yield Path(place, "data.log")
        real = {name: os.path.realpath(Path(place, name)) for name in folders}
        folders[:] = [name for name in sorted(folders) if real[name] not in visited]
        visited.update(real.values())


def read_touches(
    log: Path, virtual_taxels: Mapping[str, tuple[int, ...]] | None, problems: list[Problem]
) -> tuple[Touch, ...]:
    """Return the touched virtual taxels by stamp; rows that cannot be read are added to `problems` and left out.

    Contacts on body parts that `virtual_taxels` does not name are left out; without `virtual_taxels` a log of
    contacts is noted and not read.  InputError where the log cannot be opened, or holds rows but no readable one.
    """
    rows = read_log(log, None, problems)
    if any(row.words[0].startswith("((") for row in rows if row.words):
        if virtual_taxels is None:
            reason = "the robot's contacts; expected --taxels TAXELS.ini, which says what virtual taxels they touch"
            problems.append(Problem(ProblemKind.TOUCHES, log, None, reason))
            return ()
        expected = "contacts ((4 whole numbers) (5 vectors of 3) (taxels) pressure)"
    else:
        virtual_taxels = None
        expected = "touched taxels as part:id"
    touches = []
    bad = []
    for row in rows:
        try:
            ids = _named_taxels(row.words) if virtual_taxels is None else _of_contacts(row.words, virtual_taxels)
            touches.append(Touch(row.stamp_s, ids))
        except ValueError as error:
            bad.append(Problem(ProblemKind.ROW, log, row.line, f"{first_line(error)}; expected {expected}"))
    if bad and not touches:
        raise InputError(log, f"{bad[0].message}; none of {len(bad)} rows can be read", bad[0].line)
    problems += bad
    return tuple(touches)


def _named_taxels(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the words if all are "part:id"."""
    for word in words:
        part, _, taxel = word.partition(":")
        if not (part.isidentifier() and taxel.isdecimal()):
            raise ValueError(f"'{word[:40]}'")
    return words


def _of_contacts(words: tuple[str, ...], virtual_taxels: Mapping[str, tuple[int, ...]]) -> tuple[str, ...]:
    """Return the virtual taxels that the contacts of a row touch, each once."""
    touched = []
    for contact in parse_lists(" ".join(words)):
        if isinstance(contact, str) or len(contact) != 8 or not isinstance(contact[7], str):
            raise ValueError("no contact")
        ids, *vectors, taxels, pressure = contact
        for vector in vectors:
            parse_numbers(vector, finite, 3)
        finite(str(pressure))
        part = SKIN_PARTS.get(parse_numbers(ids, whole, 4)[3], "")
        of_part = virtual_taxels.get(part, ())
        virtual = [of_part[taxel] for taxel in parse_numbers(taxels, whole) if 0 <= taxel < len(of_part)]
        touched += [f"{part}:{taxel}" for taxel in virtual if taxel >= 0]
    return tuple(dict.fromkeys(touched))
