"""Tracks and detections in the forms of other tools: TUM, Anipose, MOTChallenge, COCO, ROS 2 bags.

| form | files | holds |
|---|---|---|
| tum | trajectory.tum | `stamp x y z 0 0 0 1` of every known position, s and m |
| anipose | trajectory_anipose.csv | a row for every pair, m; `fnum` counts them from 0 |
| mot | mot_left.txt, mot_right.txt | boxes; frames and pixels count from 1 |
| coco | coco.json | images, boxes with score, frame and track; pixels count from 0 |
| ros2 | trajectory_ros2/ (MCAP) | geometry_msgs/PoseWithCovarianceStamped of every known position on /object |

Tracks are numbered: after an object was lost, the next one is another.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings import Form
from pps_vision.recordings.tables import Box, write_table
from pps_vision.types import Array, Detection2D, Status, Track3D

_POINT = "object"  # what Anipose's columns and COCO's category call what is tracked
_ANIPOSE = (
    *(f"{_POINT}_{name}" for name in ("x", "y", "z", "error", "ncams", "score")),
    *(f"M_{row}{column}" for row in range(3) for column in range(3)),
    *(f"center_{axis}" for axis in range(3)),
    "fnum",
)
_NO_ROTATION = (*np.eye(3).ravel().tolist(), 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TrackedPair:
    """What tracking gave for one stereo pair.

    Attributes:
        images: Files of the left and the right image.
        track: The track.
        detections: In either image.
        residual_px: RMS reprojection error of the two detections; NaN without both.
    """

    images: tuple[Path, Path]
    track: Track3D
    detections: tuple[Detection2D, ...]
    residual_px: float = np.nan


@dataclass(frozen=True)
class SeenBox:
    """A box in the image of a frame, counted from 1, of a numbered track."""

    frame: int
    track: int
    box_px: Box
    score: float


def write_forms(folder: Path, forms: Iterable[Form], pairs: Sequence[TrackedPair], image_size: tuple[int, int]) -> None:
    """Write what was tracked, in order of time, in these forms into a folder; `image_size` is width and height."""
    seen = {camera: _boxes(pairs, camera) for camera in ("left", "right")}
    for form in dict.fromkeys(forms):
        if form == "tum":
            write_tum(folder / "trajectory.tum", [pair.track for pair in pairs])
        elif form == "anipose":
            write_anipose(folder / "trajectory_anipose.csv", pairs)
        elif form == "ros2":
            write_ros2(folder / "trajectory_ros2", [pair.track for pair in pairs])
        elif form == "mot":
            for camera, boxes in seen.items():
                write_mot(folder / f"mot_{camera}.txt", boxes)
        else:
            images = {camera: [pair.images[side] for pair in pairs] for side, camera in enumerate(seen)}
            write_coco(folder / "coco.json", seen, images, image_size)


def write_tum(file: Path, tracks: Iterable[Track3D]) -> None:
    """Write the known positions in TUM's form, "stamp x y z qx qy qz qw"; a tracked point has no rotation."""
    known = [track for track in tracks if track.is_known]
    write_tum_rows(file, [track.stamp_s for track in known], [track.position for track in known])


def write_tum_rows(file: Path, stamps_s: Iterable[float], positions: Iterable[Array]) -> None:
    """Write stamps and positions (3,) in TUM's form."""
    rows = (
        f"{float(stamp_s)!r} {' '.join(map(repr, position.tolist()))} 0 0 0 1\n"
        for stamp_s, position in zip(stamps_s, positions, strict=True)
    )
    file.write_text("# stamp_s x_m y_m z_m qx qy qz qw\n" + "".join(rows))


def write_anipose(file: Path, pairs: Iterable[TrackedPair]) -> None:
    """Write the table that Anipose's triangulation makes, with one point "object"; score is that of the worse image."""

    def row(frame: int, pair: TrackedPair) -> tuple[object, ...]:
        seen = pair.detections if pair.track.is_known else ()
        score = min((float(detection.score) for detection in seen), default=0.0)
        return (*pair.track.position, pair.residual_px, len(seen), score, *_NO_ROTATION, frame)

    write_table(file, _ANIPOSE, (row(frame, pair) for frame, pair in enumerate(pairs)))


def write_ros2(folder: Path, tracks: Iterable[Track3D]) -> None:
    """Write a ROS 2 bag of the known positions, in the frame "root"; a tracked point has no rotation, whose variance is
    -1.  InputError without the extra `ros`."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(folder, "needs the extra ros: pip install 'pps-vision[ros]'") from error
    store, kind = get_typestore(Stores.ROS2_JAZZY), "geometry_msgs/msg/PoseWithCovarianceStamped"
    known: Any = {name.rsplit("/", 1)[-1]: make for name, make in store.types.items()}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection(f"/{_POINT}", kind, typestore=store)
        for track in tracks:
            if not track.is_known:
                continue
            nanoseconds = round(1e9 * track.stamp_s)
            stamp = known["Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
            x, y, z = track.position.tolist()
            pose = known["Pose"](known["Point"](x, y, z), known["Quaternion"](0.0, 0.0, 0.0, 1.0))
            cov = np.diag([0.0, 0, 0, -1, -1, -1])
            cov[:3, :3] = track.cov[:3, :3]
            message = known["PoseWithCovarianceStamped"](
                known["Header"](stamp, "root"), known["PoseWithCovariance"](pose, cov.ravel())
            )
            bag.write(connection, nanoseconds, store.serialize_cdr(message, kind))


def write_mot(file: Path, boxes: Iterable[SeenBox]) -> None:
    """Write MOTChallenge's rows: frame, track, left, top, width, height, score, and no world position."""
    rows = []
    for seen in boxes:
        x, y, width, height = map(float, seen.box_px)
        rows.append(
            f"{seen.frame},{seen.track},{x + 1!r},{y + 1!r},{width!r},{height!r},{float(seen.score)!r},-1,-1,-1\n"
        )
    file.write_text("".join(rows))


def write_coco(
    file: Path,
    boxes: Mapping[str, Sequence[SeenBox]],
    images: Mapping[str, Sequence[Path]],
    image_size: tuple[int, int],
) -> None:
    """Write COCO's JSON; `boxes` and `images` (a file for each frame) by the camera's name."""
    width, height = image_size
    described: list[dict[str, object]] = []
    annotations: list[dict[str, object]] = []
    for camera, files in images.items():
        first = len(described)
        described += [
            {"id": first + k, "file_name": str(path), "width": width, "height": height, "frame_id": k, "camera": camera}
            for k, path in enumerate(files, start=1)
        ]
        for seen in boxes[camera]:
            x, y, w, h = map(float, seen.box_px)
            what = {
                "id": len(annotations) + 1,
                "image_id": first + seen.frame,
                "category_id": 1,
                "track_id": seen.track,
            }
            where = {"bbox": [x, y, w, h], "area": w * h, "iscrowd": 0, "score": float(seen.score)}
            annotations.append(what | where)
    content = {"images": described, "categories": [{"id": 1, "name": _POINT}], "annotations": annotations}
    file.write_text(json.dumps(content) + "\n", encoding="utf-8", errors="backslashreplace")


def _boxes(pairs: Sequence[TrackedPair], camera: str) -> list[SeenBox]:
    """The boxes of one camera's detections."""
    found, track = [], 1
    for frame, pair in enumerate(pairs, start=1):
        found += [SeenBox(frame, track, seen.box_px, seen.score) for seen in pair.detections if seen.camera == camera]
        track += pair.track.status == Status.LOST
    return found
