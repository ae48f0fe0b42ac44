"""A recording of another group's iCub simulator, as yarpdatadumper wrote it."""

from pathlib import Path

import numpy as np
import pytest
from data import shared_data

from pps_vision.recordings.open import open_recording
from pps_vision.recordings.warnings import ProblemKind
from pps_vision.robot.icub import load_icub


@pytest.mark.parametrize(("skew_s", "pairs"), [(0.010, 32), (0.020, 37), (0.033, 40)])
def test_it_is_read_whole_and_paired_by_stamp(skew_s, pairs):
    recording = open_recording(shared_data("yarp_dump"), max_skew_s=skew_s)
    frames = list(recording)
    assert (len(recording), len(frames), recording.image_size) == (pairs, pairs, (320, 240))
    # 40 images an eye: the only problems are unpaired images
    assert {problem.kind for problem in recording.problems} <= {ProblemKind.UNPAIRED}
    assert sum(problem.count for problem in recording.problems) == 2 * (40 - pairs)
    assert all(abs(frame.stamp_left_s - frame.stamp_right_s) <= skew_s for frame in frames)
    assert sum(problem.count for problem in recording.problems if "left" in problem.file.parts) == 40 - pairs


def test_joints_lie_between_the_encoder_samples_around_the_image():
    folder = shared_data("yarp_dump")
    robot = load_icub()
    pitch, elbow = robot.indices(("neck_pitch", "right_elbow"))
    for port, column, index in (("head", 0, pitch), ("rightArm", 3, elbow)):
        table = np.loadtxt(folder / port / "data.log")
        for frame in open_recording(folder):
            after = int(np.argmax(table[:, 1] > frame.stamp_left_s))
            low, high = sorted(np.deg2rad(table[[after - 1, after], 2 + column]))
            assert low - 1e-9 <= frame.joints_left_rad[index] <= high + 1e-9


def test_an_image_is_the_file_of_its_row():
    folder = shared_data("yarp_dump")
    number, frame = next(open_recording(folder).numbered())
    raw: Path = folder / "cam" / "left" / f"{number:08d}.ppm"
    pixels = np.frombuffer(raw.read_bytes()[-320 * 240 * 3 :], np.uint8).reshape(240, 320, 3)
    np.testing.assert_array_equal(frame.left, pixels)
