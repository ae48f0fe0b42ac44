"""A small recording of random images and joints for the tests of reader and writer."""

from dataclasses import dataclass
from pathlib import Path

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
