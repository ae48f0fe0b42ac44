"""Tracks and detections in the forms of other tools: TUM, Anipose, MOTChallenge, COCO, ROS 2 bags.

| form | files | holds |
|---|---|---|
| tum | trajectory.tum | `stamp x y z 0 0 0 1` of every known position, s and m |
| anipose | trajectory_anipose.csv | a row for every pair, m; `fnum` counts them from 0 |
| mot | mot_left.txt, mot_right.txt | boxes with `track_id`; frames and pixels count from 1 |
| coco | coco.json | images, boxes with score, frame and `track_id`; pixels count from 0 |
| ros2 | trajectory_ros2/ (MCAP) | geometry_msgs/PoseWithCovarianceStamped of every known position on /object |

Positions are the attended object's, boxes all objects'.  Of several named points all positions are
written: in columns of their names in Anipose's table, in trajectory_1.tum, … and on /object_1, …, in their order.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import count
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings import Form
from pps_vision.recordings.tables import Box, open_table
from pps_vision.types import Array, Detection2D, Track3D

_POINT = "object"  # name of the object in Anipose's columns and COCO's category
_ANIPOSE_POINT = ("x", "y", "z", "error", "ncams", "score")
_ANIPOSE_FRAME = (
    *(f"M_{row}{column}" for row in range(3) for column in range(3)),
    *("center_0", "center_1", "center_2", "fnum"),
)
_WRITER = f"pps-vision {version('pps-vision')}"
_TUM_HEADER = f"# {_WRITER}: stamp_s x_m y_m z_m qx qy qz qw\n"
_CAMERAS = "left", "right"


@dataclass(frozen=True, slots=True)
class TrackedPair:
    """Result of tracking for one stereo pair: the attended object's, and the other known objects'."""

    images: tuple[Path, Path]  # files of the left and the right image
    track: Track3D
    detections: tuple[Detection2D, ...]  # in either image
    residual_px: float = np.nan  # RMS reprojection error of the two detections; NaN without both
    others: tuple["TrackedPair", ...] = ()

    @property
    def objects(self) -> tuple["TrackedPair", ...]:
        """The attended object and the others."""
        return self, *self.others


@dataclass(frozen=True, slots=True)
class SeenBox:
    """A box in the image of a frame, counted from 1, of a numbered track."""

    frame: int
    track: int
    box_px: Box
    score: float


_Add = Callable[[TrackedPair, int], object]
"""Add a pair and its frame, counted from 1."""


@contextmanager
def open_forms(
    folder: Path, forms: Iterable[Form], size: tuple[int, int], names: Sequence[str] = (_POINT,)
) -> Iterator[Callable[[TrackedPair], None]]:
    """A function that adds the next pair to the files of these forms in a folder.

    `size` is width and height; of several `names`, the objects of each pair are those points."""
    frames = count(1)
    with ExitStack() as stack:
        adds: list[_Add] = [stack.enter_context(_WRITERS[form](folder, size, names)) for form in dict.fromkeys(forms)]

        def add(pair: TrackedPair) -> None:
            frame = next(frames)
            for write in adds:
                write(pair, frame)

        yield add


@contextmanager
def _tum(folder: Path, _: tuple[int, int], names: Sequence[str]) -> Iterator[_Add]:
    """TUM's form, "stamp x y z qx qy qz qw", of the known positions; a tracked point has no rotation."""
    with ExitStack() as stack:
        streams = [stack.enter_context((folder / f"trajectory{end}.tum").open("w")) for end in _endings(names)]
        for stream in streams:
            stream.write(_TUM_HEADER)

        def add(pair: TrackedPair, _: int) -> None:
            for stream, item in zip(streams, pair.objects, strict=False):
                if item.track.is_known:
                    stream.write(_tum_row(item.track.stamp_s, item.track.position))

        yield add


def _endings(names: Sequence[str]) -> list[str]:
    """Endings of the names of files for these points."""
    return [f"_{k}" for k in range(1, len(names) + 1)] if len(names) > 1 else [""]


def write_tum_rows(file: Path, stamps_s: Iterable[float], positions: Iterable[Array]) -> None:
    """Write stamps and positions (3,) in TUM's form."""
    file.write_text(_TUM_HEADER + "".join(map(_tum_row, stamps_s, positions)))


def _tum_row(stamp_s: float, position: Array) -> str:
    return f"{float(stamp_s)!r} {' '.join(map(repr, position.tolist()))} 0 0 0 1\n"


@contextmanager
def _anipose(folder: Path, _: tuple[int, int], names: Sequence[str]) -> Iterator[_Add]:
    """The table that Anipose's triangulation makes; score is that of the worse image."""
    columns = [f"{name}_{column}" for name in names for column in _ANIPOSE_POINT]
    with open_table(folder / "trajectory_anipose.csv", (*columns, *_ANIPOSE_FRAME)) as write:

        def add(pair: TrackedPair, frame: int) -> None:
            row: list[object] = []
            for item in pair.objects[: len(names)]:
                detections = item.detections if item.track.is_known else ()
                score = min((float(detection.score) for detection in detections), default=0.0)
                row += (*item.track.position, item.residual_px, len(detections), score)
            write((*row, *np.eye(3).ravel(), *np.zeros(3), frame - 1))  # no rotation, no offset

        yield add


@contextmanager
def _ros2(folder: Path, _: tuple[int, int], names: Sequence[str]) -> Iterator[_Add]:
    """A ROS 2 bag of the known positions, in the frame "root"; a tracked point has no rotation, whose variance is
    -1.  InputError without the extra `ros`."""
    bag_folder = folder / "trajectory_ros2"
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(bag_folder, "needs the extra ros: pip install 'pps-vision[ros]'") from error
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    make: Any = {name.rsplit("/", 1)[-1]: message for name, message in store.types.items()}
    with Writer(bag_folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = [bag.add_connection(f"/{_POINT}{end}", kind, typestore=store) for end in _endings(names)]

        def add(pair: TrackedPair, _: int) -> None:
            for connection, item in zip(connections, pair.objects, strict=False):
                track = item.track
                if not track.is_known:
                    continue
                nanoseconds = round(1e9 * track.stamp_s)
                header = make["Header"](make["Time"](nanoseconds // 10**9, nanoseconds % 10**9), "root")
                point = make["Point"](*track.position.tolist())
                pose = make["Pose"](point, make["Quaternion"](0.0, 0.0, 0.0, 1.0))
                cov = np.diag([0.0, 0, 0, -1, -1, -1])
                cov[:3, :3] = track.cov[:3, :3]
                message = make["PoseWithCovarianceStamped"](header, make["PoseWithCovariance"](pose, cov.ravel()))
                bag.write(connection, nanoseconds, store.serialize_cdr(message, kind))

        yield add


@contextmanager
def _mot(folder: Path, _: tuple[int, int], names: Sequence[str]) -> Iterator[_Add]:
    with ExitStack() as stack:
        files = {camera: stack.enter_context((folder / f"mot_{camera}.txt").open("w")) for camera in _CAMERAS}

        def add(pair: TrackedPair, frame: int) -> None:
            for camera, file in files.items():
                file.writelines(map(_mot_row, _boxes(pair, frame, camera)))

        yield add


@contextmanager
def _coco(folder: Path, size: tuple[int, int], names: Sequence[str]) -> Iterator[_Add]:
    with open_coco(folder / "coco.json", size) as add_image:

        def add(pair: TrackedPair, frame: int) -> None:
            for camera, image in zip(_CAMERAS, pair.images, strict=True):
                add_image(camera, frame, image, _boxes(pair, frame, camera))

        yield add


def _boxes(pair: TrackedPair, frame: int, camera: str) -> list[SeenBox]:
    """The boxes of one camera's detections of all objects."""
    return [
        SeenBox(frame, item.track.track_id, detection.box_px, detection.score)
        for item in pair.objects
        for detection in item.detections
        if detection.camera == camera
    ]


_WRITERS: Mapping[Form, Callable[[Path, tuple[int, int], Sequence[str]], AbstractContextManager[_Add]]]
_WRITERS = {"tum": _tum, "anipose": _anipose, "mot": _mot, "coco": _coco, "ros2": _ros2}


def write_mot(file: Path, boxes: Iterable[SeenBox]) -> None:
    """Write MOTChallenge's rows: frame, track, left, top, width, height, score, and no world position."""
    file.write_text("".join(map(_mot_row, boxes)))


def _mot_row(seen_box: SeenBox) -> str:
    x, y, width, height = map(float, seen_box.box_px)
    box = f"{x + 1!r},{y + 1!r},{width!r},{height!r}"
    return f"{seen_box.frame},{seen_box.track},{box},{float(seen_box.score)!r},-1,-1,-1\n"


@contextmanager
def open_coco(file: Path, size: tuple[int, int]) -> Iterator[Callable[[str, int, Path, Iterable[SeenBox]], None]]:
    """A function that adds the image of a camera's frame, counted from 1, and its boxes to COCO's JSON; `size` is the
    images' width and height.

    The boxes, which come behind the images, wait in a temporary file.
    """
    text = {"encoding": "utf-8", "errors": "backslashreplace"}  # a file's name may hold any bytes
    images = annotations = 0
    with file.open("w", **text) as stream, TemporaryFile("w+", dir=file.parent, **text) as waiting:  # type: ignore[call-overload]

        def add(camera: str, frame: int, path: Path, boxes: Iterable[SeenBox]) -> None:
            nonlocal images, annotations
            image = {"file_name": str(path), "width": size[0], "height": size[1], "frame_id": frame, "camera": camera}
            stream.write(", " * (images > 0) + json.dumps({"id": images + 1} | image))
            images += 1
            for seen_box in boxes:
                x, y, w, h = map(float, seen_box.box_px)
                identity = {"id": annotations + 1, "image_id": images, "category_id": 1, "track_id": seen_box.track}
                box = {"bbox": [x, y, w, h], "area": w * h, "iscrowd": 0, "score": float(seen_box.score)}
                waiting.write(", " * (annotations > 0) + json.dumps(identity | box))
                annotations += 1

        stream.write(f'{{"info": {json.dumps({"description": _WRITER})}, "images": [')
        yield add
        stream.write(f'], "categories": {json.dumps([{"id": 1, "name": _POINT}])}, "annotations": [')
        waiting.seek(0)
        copyfileobj(waiting, stream)
        stream.write("]}\n")
