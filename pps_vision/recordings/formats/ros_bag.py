"""ROS 1 bags, ROS 2 bags and MCAP files with two image topics (extra `ros`), read through rosbags."""

import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import cv2
import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.calibrations import CalibratedCamera, ros
from pps_vision.recordings.documents import Document
from pps_vision.recordings.formats.stereo_images import refuse_robot_options, with_calibration
from pps_vision.recordings.formats.yarp import with_joints
from pps_vision.recordings.image_file import MOST_PIXELS, ImageFile, Pixels, decode_bytes
from pps_vision.recordings.recording import Recording, distinct_stamps, pair_by_stamp, usual_sizes
from pps_vision.recordings.source import Source
from pps_vision.recordings.stereo_calibration import cameras_of
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Array

if TYPE_CHECKING:
    from pps_vision.robot.robot_setup import RobotSetup

FORMAT = "a ROS bag (.bag, .mcap, .db3, or a folder with metadata.yaml)"
TAKES_TOPICS = True  # as `left` and `right`
HAS_STAMPS = True
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CONVERSIONS = {  # of ROS's encodings to RGB, and their channels; OpenCV names Bayer patterns by another pixel
    **dict.fromkeys(("rgb8", "rgb16"), (None, 3)),
    **dict.fromkeys(("bgr8", "8UC3", "bgr16", "16UC3"), (cv2.COLOR_BGR2RGB, 3)),
    "rgba8": (cv2.COLOR_RGBA2RGB, 4),
    "bgra8": (cv2.COLOR_BGRA2RGB, 4),
    **dict.fromkeys(("mono8", "8UC1", "mono16", "16UC1"), (cv2.COLOR_GRAY2RGB, 1)),
    **{f"bayer_rggb{bits}": (cv2.COLOR_BayerBG2RGB, 1) for bits in (8, 16)},
    **{f"bayer_bggr{bits}": (cv2.COLOR_BayerRG2RGB, 1) for bits in (8, 16)},
    **{f"bayer_gbrg{bits}": (cv2.COLOR_BayerGR2RGB, 1) for bits in (8, 16)},
    **{f"bayer_grbg{bits}": (cv2.COLOR_BayerGB2RGB, 1) for bits in (8, 16)},
    **dict.fromkeys(("yuv422", "uyvy"), (cv2.COLOR_YUV2RGB_UYVY, 2)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), (cv2.COLOR_YUV2RGB_YUYV, 2)),
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
    joints come from the JointState topics.  InputError where the bag cannot be read, or lacks topics, a calibration or
    joints.
    """
    file = Path(str(source.folder))
    problems = list[Problem]()
    bag = Bag(file)
    topics = [bag.image_topic("left", source.left), bag.image_topic("right", source.right)]
    left, right = (distinct_stamps(bag.images(topic), problems) for topic in topics)
    pairs = pair_by_stamp(left, right, source.max_skew_s, problems)
    size, right_size = usual_sizes(file, pairs, problems)
    recording = Recording(str(file), pairs, size, problems, right_size=right_size)
    if source.calib:
        recording = with_calibration(recording, source.calib, source)
    elif missing := [topic for topic in topics if bag.info_topic(topic) is None]:
        place = f"{missing[0].rsplit('/', 1)[0]}/camera_info, or one by --calib"
        recording = replace(recording, calibration_at=place)
    else:
        infos = [bag.camera_info(topic) for topic in topics]
        cameras = cameras_of(infos, size, source, right_size=right_size)
        recording = replace(recording, rig=StereoRig.fixed(*cameras))
    if source.robot is None:
        refuse_robot_options(source)
        return recording
    if source.taxels:
        raise InputError("recording", f"taxels {source.taxels} with a ROS bag; expected it with an iCub's folder REC")
    setup = source.robot
    posed = with_joints(pairs, bag.joints(setup), problems, setup)
    if not posed:
        raise InputError(file, f"no pair has joints; {problems[-1]}")
    rig = recording.rig and replace(recording.rig, eye_poses=setup.robot.eye_poses)
    return replace(recording, pairs=posed, robot=setup.robot, rig=rig)


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

    @contextmanager
    def reading(self) -> Iterator[None]:
        """A block in which whatever rosbags raises, which is of many kinds, means that the bag is damaged."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            reason = f"cannot be read: {type(error).__name__} {first_line(error)}"
            raise InputError(self.file, f"{reason}; expected a ROS bag") from error

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
                stamps.append(_stamp_s(data))
        return [BagImage(self.file, stamp_s, messages=messages, index=index) for index, stamp_s in enumerate(stamps)]

    def info_topic(self, topic: str) -> Any | None:
        """The connection with the CameraInfo beside an image topic."""
        places = [topic.rsplit("/", up)[0] + "/camera_info" for up in (1, 2)]  # …/image_raw and …/image_raw/compressed
        infos = self.topics(("sensor_msgs/msg/CameraInfo",))
        return next((infos[place] for place in places if place in infos), None)

    def camera_info(self, topic: str) -> CalibratedCamera:
        """The calibration in the CameraInfo beside an image topic, which is there."""
        message = self.first(self.info_topic(topic))
        names = [*("kdrp" if self.reader.is2 else "KDRP"), "width", "height", "binning_x", "binning_y"]
        content = {name: getattr(message, name) for name in names}
        content["distortion_model"] = message.distortion_model or "none"
        content["roi"] = {name: getattr(message.roi, name) for name in ("x_offset", "y_offset", "width", "height")}
        camera = ros.camera_of(Document(self.file, content))
        is_rectified = any("rect" in re.split(r"[_\W]", part) for part in topic.lower().split("/")[-2:])
        return (is_rectified and camera.rectified) or camera

    def first(self, connection: Any) -> Any:
        """The first message of a connection."""
        with self.reading():
            _, _, data = next(self.reader.messages([connection]))
            return self.reader.deserialize(data, connection.msgtype)

    def joints(self, setup: "RobotSetup") -> dict[str, tuple[Array, Array]]:
        """For each port stamps (n,) and encoder readings (n, joints) in degrees, of complete messages."""
        rows: dict[str, dict[float, list[float]]] = {port: {} for port in setup.ports}
        states = list(self.topics(("sensor_msgs/msg/JointState",)).values())
        eyes = setup.robot.names.gaze_joints[3:]
        with self.reading():
            for connection, _, data in self.reader.messages(states) if states else ():
                message: Any = self.reader.deserialize(data, connection.msgtype)
                angle = {"-": 0.0, **dict(zip(message.name, np.rad2deg(message.position).tolist(), strict=False))}
                if eyes and all(eye in angle for eye in eyes):
                    left, right = (angle[eye] for eye in eyes)
                    angle |= {"version": (left + right) / 2, "vergence": left - right}
                for port, names in setup.ports.items():
                    if all(name in angle for name in names):
                        rows[port].setdefault(_stamp_s(data), [angle[name] for name in names])
        if missing := [port for port in setup.required if not rows[port]]:
            wanted = ", ".join(setup.ports[missing[0]])
            raise InputError(self.file, f"no JointState with all joints of {missing[0]}; expected {wanted}")
        logs = {port: sorted(samples.items()) for port, samples in rows.items() if samples}
        return {port: (np.array([t for t, _ in log]), np.array([q for _, q in log])) for port, log in logs.items()}


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
    any_thread: ClassVar[bool] = False  # SQLite's connections belong to a thread

    @property
    def title(self) -> str:
        """What reports call it."""
        return f"{self.messages.connection.topic} {self.index}"

    def load(self) -> Pixels | str:
        """The image as RGB, or the reason why there is none."""
        try:
            with self.messages.bag.reading():
                message = self.messages.message(self.index)
        except InputError as error:
            return error.args[1]
        return _pixels(message) if hasattr(message, "encoding") else decode_bytes(bytes(message.data))


def _stamp_s(data: bytes) -> float:
    """The stamp of a header, behind the sequence number of ROS 1 or the four bytes of CDR's own header."""
    seconds, nanoseconds = struct.unpack_from("<4xII", data)
    return float(seconds + 1e-9 * nanoseconds)


def _pixels(message: Any) -> Pixels | str:
    """The pixels of sensor_msgs/Image."""
    if message.encoding not in _CONVERSIONS:
        return f"has the encoding {message.encoding!r}; expected one of {', '.join(_CONVERSIONS)}"
    conversion, channels = _CONVERSIONS[message.encoding]
    depth = np.dtype(np.uint16 if "16" in message.encoding else np.uint8)
    height = int(message.height)
    width = int(message.width)
    step = int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    row = width * channels * depth.itemsize
    if not (0 < height * width <= MOST_PIXELS and step >= row and data.size >= height * step):
        return f"states {width}×{height} pixels, {step} bytes a row, and holds {data.size} bytes"
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    levels = rows.view(depth.newbyteorder(">" if message.is_bigendian else "<")).astype(depth)
    image = levels.reshape(height, width, channels) if channels > 1 else levels
    return np.asarray(image if conversion is None else cv2.cvtColor(image, conversion), dtype=depth)
