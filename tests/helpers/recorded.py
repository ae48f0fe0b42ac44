"""A small recording of random images and joints for the tests of reader and writer."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pps_vision.recordings.yarp_writer import YarpWriter
from pps_vision.robot.icub import icub_setup, set_gaze
from pps_vision.types import Array, StereoFrame, Truth

START_S = 1512784563.547172
SETUP = icub_setup()
ROBOT = SETUP.robot


@dataclass(frozen=True)
class Written:
    """A written recording: frames with their joints, touches and truth."""

    folder: Path
    frames: list[StereoFrame]
    touches: list[tuple[float, tuple[str, ...]]]
    truth: list[Truth]


def random_joints(rng: np.random.Generator) -> Array:
    return set_gaze(ROBOT, rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad), vergence=0.3)


def write_recording(folder: Path, n: int = 4, seed: int = 0) -> Written:
    """`n` frames 0.05 s apart, the right eye 5 ms later, joints noted at every image."""
    rng = np.random.default_rng(seed)
    written = Written(folder, [], [], [])
    with YarpWriter(folder, SETUP) as writer:
        for i in range(n):
            stamp = START_S + 0.05 * i
            images = rng.integers(0, 256, (2, 6, 8, 3), dtype=np.uint8)
            frame = StereoFrame(*images, stamp, stamp + 0.005, random_joints(rng), random_joints(rng))
            touched = ("left_forearm:27", "left_forearm:15")[: i % 3]
            truth = Truth(stamp, *rng.normal(size=(2, 3)), 0.03, *rng.normal(size=(2, 2)), True, bool(i % 2))
            writer.write_frame(frame)
            writer.write_joints(frame.stamp_left_s, frame.joints_left_rad)
            writer.write_joints(frame.stamp_right_s, frame.joints_right_rad)
            writer.write_touches(stamp, touched)
            writer.write_truth(truth)
            written.frames.append(frame)
            written.touches.append((stamp, touched))
            written.truth.append(truth)
    return written


def as_dumped(rec: Path, kind: str) -> None:
    """Store the images as yarpdatadumper does with a `--type` (of video: mkv or avi), by its source."""
    info = {"image": "Image;", "image_jpg": "Image:jpg;", "image_png": "Image:png;", "depth": "Depth;"}
    suffix = {"image": "ppm", "image_jpg": "jpg", "image_png": "png", "depth": "float"}.get(kind, "")
    for log in (rec / "cam").rglob("data.log"):
        rows = [row.split() for row in log.read_text().splitlines()]
        images = [cv2.imread(str(log.with_name(name))) for _, _, name in rows]
        for _, _, name in rows:
            log.with_name(name).unlink()
        if suffix:
            names = [f"{k:08d}.{suffix}" for k in range(len(rows))]
            for name, image in zip(names, images, strict=True):
                if kind != "depth":
                    cv2.imwrite(str(log.with_name(name)), image)
            names = [f"{name} [{'mono_float' if kind == 'depth' else 'rgb'}]" for name in names]
        else:
            names = [f"frame_{k:08d}" for k in range(len(rows))]
            code = cv2.VideoWriter.fourcc(*"HFYU")
            size = images[0].shape[1::-1]
            video = cv2.VideoWriter(str(log.with_name(f"video.{kind}")), code, 20, size)
            for image in images:
                video.write(image)
            video.release()
        log.with_name("info.log").write_text(f"Type: {info.get(kind, f'Image; Video:{kind}(huffyuv);')}\nStamp: rx;\n")
        log.write_text("".join(f"{row[0]} {row[1]} {name}\n" for row, name in zip(rows, names, strict=True)))
