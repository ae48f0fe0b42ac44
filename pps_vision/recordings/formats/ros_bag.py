"""ROS 1 bags, ROS 2 bags and MCAP files with two image topics (extra `ros`), read through rosbags."""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.calibration_files import Matrices, ros_matrices
from pps_vision.recordings.formats.stereo_images import fixed_rig, refuse_robot_options, rig_of
from pps_vision.recordings.formats.yarp import with_joints
from pps_vision.recordings.image_file import MOST_PIXELS, ImageFile, decode_bytes
from pps_vision.recordings.recording import Recording, Source, distinct_stamps, pair_by_stamp, usual_size
from pps_vision.recordings.stereo_calibration import cameras_of
from pps_vision.recordings.tables import read_joint_offsets
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Array, Image

if TYPE_CHECKING:
    from pps_vision.robot.robot_setup import RobotSetup

FORMAT = "a ROS bag (.bag, .mcap, .db3, or a folder with metadata.yaml)"
TAKES_TOPICS = True  # as `left` and `right`
HAS_STAMPS = True
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
# Seconds and nanoseconds of a header, behind the sequence number of ROS 1 or the four bytes of CDR's own header.
_STAMP = struct.Struct("<4xII")
_CONVERSIONS = {  # of ROS's encodings to RGB, and their channels; OpenCV names Bayer patterns by another pixel
    "rgb8": (None, 3),
    "bgr8": (cv2.COLOR_BGR2RGB, 3),
    "8UC3": (cv2.COLOR_BGR2RGB, 3),
    "rgba8": (cv2.COLOR_RGBA2RGB, 4),
    "bgra8": (cv2.COLOR_BGRA2RGB, 4),
    "mono8": (cv2.COLOR_GRAY2RGB, 1),
    "8UC1": (cv2.COLOR_GRAY2RGB, 1),
    "bayer_rggb8": (cv2.COLOR_BayerBG2RGB, 1),
    "bayer_bggr8": (cv2.COLOR_BayerRG2RGB, 1),
    "bayer_gbrg8": (cv2.COLOR_BayerGR2RGB, 1),
    "bayer_grbg8": (cv2.COLOR_BayerGB2RGB, 1),
}


def recognises(source: Source) -> bool:
    """Return whether this is the format of a source."""
    if source.folder is None:
        return False
    return source.folder.suffix in (".bag", ".mcap", ".db3") or (source.folder / "metadata.yaml").is_file()


def open_source(source: Source) -> Recording:
    """Open two image topics of `source.folder`, paired by the stamps of their headers.

    The topics are `source.left` and `source.right`, or the only ones whose names hold left and right.  Without
    `source.calib` the calibration is in the CameraInfo topics beside them; the pixels of a topic with the word "rect"
    in the last two parts of its name (image_rect, image_rect_color/compressed) are rectified.  With `source.robot` its
    joints come from the JointState topics.

    Raises:
        InputError: The bag cannot be read, or lacks topics, a calibration or joints.
    """
    file = Path(str(source.folder))
    problems = list[Problem]()
    bag = Bag(file)
    topics = [bag.image_topic("left", source.left), bag.image_topic("right", source.right)]
    left, right = (distinct_stamps(bag.images(topic), problems) for topic in topics)
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    size = usual_size(file, pairs, problems)
    rig = None
    calibration_at = ""
    warnings = list[str]()
    if source.calib:
        rig = fixed_rig(source.calib, size, source.unit_m, warnings=warnings)
    elif missing := [topic for topic in topics if bag.info_topic(topic) is None]:
        calibration_at = f"{missing[0].rsplit('/', 1)[0]}/camera_info, or one by --calib"
    else:
        infos = [(file, bag.camera_info(topic)) for topic in topics]
        rig = rig_of(cameras_of(infos, size, warnings=warnings), file)
    recording = Recording(
        str(file), pairs, size, problems, rig=rig, warnings=tuple(warnings), calibration_at=calibration_at
    )
    if source.robot is None:
        refuse_robot_options(source)
        return recording
    if source.taxels:
        raise InputError("recording", f"taxels {source.taxels} with a ROS bag; expected it with an iCub's folder REC")
    joints = bag.joints(source.robot)
    setup = source.robot
    offsets_rad = read_joint_offsets(source.joints, setup.robot.joint_names) if source.joints else 0.0
    posed = with_joints(pairs, joints, problems, setup, offsets_rad)
    if not posed:
        raise InputError(file, f"no pair has joints; {problems[-1]}")
    moving = StereoRig(rig.left, rig.right, setup.robot.eye_poses) if rig else None
    return replace(recording, pairs=posed, robot=setup.robot, rig=moving)


class Bag:
    """An open bag; InputError for one that cannot be read."""

    def __init__(self, file: Path) -> None:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise InputError(file, "is a ROS bag; expected the extra ros: pip install 'pps-vision[ros]'") from error
        self.file = file
        with self.reading():
            self.reader = AnyReader([file], default_typestore=get_typestore(Stores.LATEST))
            self.reader.open()

    def reading(self) -> "_Reading":
        """A block in which whatever rosbags raises means that the bag is damaged."""
        return _Reading(self.file)

    def topics(self, kinds: tuple[str, ...]) -> dict[str, Any]:
        """The connections of message types, by topic."""
        return {stream.topic: stream for stream in self.reader.connections if stream.msgtype in kinds}

    def image_topic(self, side: str, requested: tuple[str, ...]) -> str:
        """The topic that is given, or the only one whose name holds the side."""
        image_topics = self.topics(_IMAGES)
        fitting = list(requested) or [name for name in image_topics if side in name.lower()]
        if len(fitting) == 1 and fitting[0] in image_topics:
            return fitting[0]
        listed = ", ".join(sorted(image_topics)) or "no image topic"
        named = f"{len(fitting)} {side} image topics" if not requested else f"no topic {' '.join(requested)}"
        raise InputError(self.file, f"{named} among {listed}; expected one, by --{side} TOPIC where it is not plain")

    def images(self, topic: str) -> list["BagImage"]:
        """All images of a topic, not yet decoded."""
        messages = Messages(self, topic)
        stamps = []
        with self.reading():
            for _, _, data in self.reader.messages([messages.connection]):
                seconds, nanoseconds = _STAMP.unpack_from(data)
                stamps.append(seconds + 1e-9 * nanoseconds)
        return [BagImage(self.file, stamp_s, messages=messages, index=index) for index, stamp_s in enumerate(stamps)]

    def info_topic(self, topic: str) -> Any | None:
        """The connection with the CameraInfo beside an image topic."""
        places = [topic.rsplit("/", up)[0] + "/camera_info" for up in (1, 2)]  # …/image_raw and …/image_raw/compressed
        infos = self.topics(("sensor_msgs/msg/CameraInfo",))
        return next((infos[place] for place in places if place in infos), None)

    def camera_info(self, topic: str) -> Matrices:
        """The calibration in the CameraInfo beside an image topic, which is there."""
        message = self.first(self.info_topic(topic))
        K, D, R, P = (
            np.asarray(getattr(message, key if self.reader.is2 else key.upper()), dtype=float) for key in "kdrp"
        )
        content = {
            "image_width": message.width,
            "image_height": message.height,
            "camera_matrix": K.ravel().tolist(),
            "distortion_model": message.distortion_model or "none",
            "distortion_coefficients": D.ravel().tolist(),
            "rectification_matrix": R.ravel().tolist(),
            "projection_matrix": P.ravel().tolist(),
        }
        if any("rect" in re.split(r"[_\W]", part) for part in topic.lower().split("/")[-2:]):
            content |= {
                "camera_matrix": np.reshape(P, (3, 4))[:, :3].ravel().tolist(),
                "distortion_coefficients": [],
                "rectification_matrix": np.eye(3).ravel().tolist(),
            }
        return ros_matrices(self.file, content)

    def first(self, connection: Any) -> Any:
        """The first message of a connection."""
        with self.reading():
            _, _, data = next(self.reader.messages([connection]))
            return self.reader.deserialize(data, connection.msgtype)

    def joints(self, setup: "RobotSetup") -> dict[str, tuple[Array, Array]]:
        """For each port stamps (n,) and encoder readings (n, joints) in degrees, of complete messages."""
        stamps: dict[str, list[float]] = {port: [] for port in setup.ports}
        rows: dict[str, list[Array]] = {port: [] for port in setup.ports}
        states = list(self.topics(("sensor_msgs/msg/JointState",)).values())
        with self.reading():
            for connection, _, data in self.reader.messages(states) if states else ():
                message: Any = self.reader.deserialize(data, connection.msgtype)
                angle = {"-": 0.0, **dict(zip(message.name, np.rad2deg(message.position).tolist(), strict=False))}
                eyes = setup.robot.names.gaze_joints[3:]
                if eyes and all(eye in angle for eye in eyes):
                    angle |= {
                        "version": sum(angle[eye] for eye in eyes) / 2,
                        "vergence": angle[eyes[0]] - angle[eyes[1]],
                    }
                seconds, nanoseconds = _STAMP.unpack_from(data)
                for port, names in setup.ports.items():
                    if all(name in angle for name in names):
                        stamps[port].append(seconds + 1e-9 * nanoseconds)
                        rows[port].append(np.array([angle[name] for name in names]))
        if missing := [port for port in setup.required if not stamps[port]]:
            wanted = ", ".join(setup.ports[missing[0]])
            raise InputError(self.file, f"no JointState with all joints of {missing[0]}; expected {wanted}")
        logs = {}
        for port in setup.ports:
            if stamps[port]:
                order, order_first = np.unique(stamps[port], return_index=True)
                logs[port] = (order, np.array(rows[port])[order_first])
        return logs


@dataclass(frozen=True)
class _Reading:
    """Turns what rosbags raises on a damaged bag, which is of many kinds, into InputError."""

    file: Path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, InputError) or not isinstance(error, Exception):
            return
        image_topics = f"cannot be read: {type(error).__name__} {first_line(error)}"
        raise InputError(self.file, f"{image_topics}; expected a ROS bag") from error


class Messages:
    """The messages of a topic: the next one costs one, an earlier one a new beginning."""

    def __init__(self, bag: Bag, topic: str) -> None:
        self.bag = bag
        self.connection = bag.topics(_IMAGES)[topic]
        self._next: Iterator[Any] = iter(())
        self._last: tuple[int, Any] = -1, None

    def message(self, index: int) -> Any:
        """The message of this number, from 0."""
        at, message = self._last
        if index == at:
            return message
        if index < at or at < 0:
            self._next = iter(self.bag.reader.messages([self.connection]))
            at = -1
        while at < index:
            (_, _, data), at = next(self._next), at + 1
        self._last = at, self.bag.reader.deserialize(data, self.connection.msgtype)
        return self._last[1]


@dataclass(frozen=True, slots=True)
class BagImage(ImageFile):
    """An image in a bag."""

    messages: Messages = field(repr=False, compare=False, kw_only=True)
    index: int = field(kw_only=True)

    @property
    def number(self) -> int:
        """Its place in the topic, from 0."""
        return self.index

    @property
    def title(self) -> str:
        """What reports call it."""
        return f"{self.messages.connection.topic} {self.index}"

    def load(self) -> Image | str:
        """The image as RGB uint8, or the reason why there is none."""
        try:
            with self.messages.bag.reading():
                message = self.messages.message(self.index)
        except InputError as error:
            return error.args[1]
        if not hasattr(message, "encoding"):
            return decode_bytes(bytes(message.data))
        return _pixels(message)


def _pixels(message: Any) -> Image | str:
    """The pixels of sensor_msgs/Image."""
    if message.encoding not in _CONVERSIONS:
        return f"has the encoding {message.encoding!r}; expected one of {', '.join(_CONVERSIONS)}"
    conversion, channels = _CONVERSIONS[message.encoding]
    height = int(message.height)
    width = int(message.width)
    step = int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    if not (0 < height * width <= MOST_PIXELS and step >= width * channels and data.size >= height * step):
        return f"states {width}×{height} pixels, {step} bytes a row, and holds {data.size} bytes"
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    image = np.ascontiguousarray(rows.reshape(height, width, channels) if channels > 1 else rows)
    return image if conversion is None else np.asarray(cv2.cvtColor(image, conversion), dtype=np.uint8)
