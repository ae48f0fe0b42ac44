"""Small ROS bags, written message by message with rosbags (extra `ros`)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from pps_vision.types import Array, Image


class BagWriter:
    """A ROS 1 bag, or a ROS 2 bag with this storage, as a context manager."""

    def __init__(self, path: Path, storage: Literal["ros1", "sqlite3", "mcap"]) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self._is_ros1 = storage == "ros1"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_JAZZY)
        self._topics: dict[str, Any] = {}
        self._writer: Any
        if self._is_ros1:
            self._writer = rosbag1.Writer(path)
        else:
            plugin = rosbag2.StoragePlugin[storage.upper()]
            self._writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)

    def __enter__(self) -> "BagWriter":
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def write(self, topic: str, message: Any, received_s: float) -> None:
        """Append a message to a topic, as received at a time."""
        kind = message.__msgtype__
        if topic not in self._topics:
            self._topics[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        serialize = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
        self._writer.write(self._topics[topic], round(received_s * 1e9), serialize(message, kind))

    def image(self, image: Image, encoding: str, stamp_s: float) -> Any:
        """Return an Image of pixels (H, W, C) in an encoding; its rows are 3 bytes longer than their pixels."""
        rows = np.ascontiguousarray(image).reshape(image.shape[0], -1)
        wide = np.pad(rows.view(np.uint8), ((0, 0), (0, 3)))
        shape = {"height": image.shape[0], "width": image.shape[1], "step": wide.shape[1]}
        order = int(image.dtype.byteorder == ">")
        return self._message("Image", stamp_s, **shape, encoding=encoding, is_bigendian=order, data=wide.ravel())

    def png(self, image: Image, stamp_s: float) -> Any:
        """Return a CompressedImage of BGR pixels (H, W, 3)."""
        return self._message("CompressedImage", stamp_s, format="png", data=cv2.imencode(".png", image)[1].ravel())

    def camera_info(self, P: Array, size: tuple[int, int], distortion: Sequence[float] = (0, 0, 0, 0, 0)) -> Any:
        """Return the CameraInfo of a projection (3, 4), px, of images of a size (width, height)."""
        fields = {"k": P[:, :3].ravel(), "d": np.array(distortion, float), "r": np.eye(3).ravel(), "p": P.ravel()}
        area = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
        roi = self._store.types["sensor_msgs/msg/RegionOfInterest"](**area, do_rectify=False)
        shape = {"height": size[1], "width": size[0], "roi": roi, "binning_x": 0, "binning_y": 0}
        named = {key.upper() if self._is_ros1 else key: value for key, value in fields.items()}
        return self._message("CameraInfo", 0.0, **shape, distortion_model="plumb_bob", **named)

    def joints(self, names: Sequence[str], position_rad: Array, stamp_s: float) -> Any:
        """Return a JointState without velocities and efforts."""
        nothing = np.zeros(0)
        return self._message(
            "JointState", stamp_s, name=list(names), position=position_rad, velocity=nothing, effort=nothing
        )

    def _message(self, kind: str, stamp_s: float, **fields: Any) -> Any:
        nanoseconds = round(stamp_s * 1e9)
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        number = {"seq": 0} if self._is_ros1 else {}
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **number)
        return types[f"sensor_msgs/msg/{kind}"](header=header, **fields)
