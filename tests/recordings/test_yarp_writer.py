"""A recording written is the recording read, laid out as yarpdatadumper does."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import ROBOT, SETUP, write_recording

from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.icub_eyes import fit_to_images, read_icub_eyes
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.yarp_writer import YarpWriter
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE


def test_what_is_written_is_read(tmp_path):
    written = write_recording(tmp_path / "rec")
    recording = open_recording(tmp_path / "rec")
    assert (recording.name, recording.image_size, recording.problems) == (str(tmp_path / "rec"), (8, 6), [])
    frames = list(recording)
    assert len(recording) == len(frames) == len(written.frames)
    for back, frame in zip(frames, written.frames, strict=True):
        np.testing.assert_array_equal(back.left, frame.left)
        np.testing.assert_array_equal(back.right, frame.right)
        assert (back.stamp_left_s, back.stamp_right_s) == (frame.stamp_left_s, frame.stamp_right_s)
        np.testing.assert_allclose(back.joints_left_rad, frame.joints_left_rad, atol=1e-8)
        np.testing.assert_allclose(back.joints_right_rad, frame.joints_right_rad, atol=1e-8)
    assert [(touch.stamp_s, touch.taxel_ids) for touch in recording.touches] == written.touches
    assert [row.stamp_s for row in recording.truth] == [row.stamp_s for row in written.truth]
    assert read_icub_eyes(tmp_path / "rec" / "icubEyes.ini") == (LEFT_EYE, RIGHT_EYE)
    assert recording.rig is not None
    assert recording.rig.left == fit_to_images(LEFT_EYE, (8, 6), tmp_path)


def test_the_layout_is_yarpdatadumpers(tmp_path):
    write_recording(tmp_path / "rec", n=2)
    files = sorted(str(file.relative_to(tmp_path / "rec")) for file in (tmp_path / "rec").rglob("*") if file.is_file())
    ports = ("cam/left", "cam/right", "head", "left_arm", "right_arm", "skin", "torso")
    expected = [f"{port}/{name}" for port in ports for name in ("data.log", "info.log")]
    expected += [f"cam/{side}/0000000{i}.ppm" for side in ("left", "right") for i in (0, 1)]
    assert files == sorted([*expected, "icubEyes.ini", "truth.csv"])
    assert (tmp_path / "rec/cam/left/info.log").read_text() == "Type: Image:ppm;\n"
    assert (tmp_path / "rec/cam/left/data.log").read_text().splitlines()[0] == "0 1512784563.547172 00000000.ppm"
    assert (tmp_path / "rec/skin/data.log").read_text().splitlines()[1].split()[2:] == ["left_forearm:27"]


def test_encoders_are_in_the_robots_order_and_degrees(tmp_path):
    q = np.zeros(ROBOT.n_joints)
    names = ("torso_yaw", "neck_pitch", "left_eye_pan", "right_eye_pan", "right_elbow")
    q[ROBOT.indices(names)] = np.deg2rad([3, -20, 15, 5, 40])
    with YarpWriter(tmp_path / "rec", SETUP) as writer:
        writer.write_joints(1.0, q)
    rows = {
        port: np.array((tmp_path / "rec" / port / "data.log").read_text().split(), dtype=float)
        for port in ("torso", "head", "right_arm")
    }
    np.testing.assert_allclose(rows["torso"], [0, 1, 3, 0, 0])
    np.testing.assert_allclose(rows["head"], [0, 1, -20, 0, 0, 0, 10, 10])
    np.testing.assert_allclose(rows["right_arm"], [0, 1, 0, 0, 0, 40, *[0] * 12])


def test_cameras_the_calibration_cannot_hold_leave_nothing(tmp_path):
    bent = LEFT_EYE.__class__(8, 6, 5, 5, 4, 3, (0, 0, 0, 0, 0.1))
    setup = replace(SETUP, rig=StereoRig(LEFT_EYE, bent, ROBOT.eye_poses))
    with pytest.raises(ValueError, match="k3"), YarpWriter(tmp_path / "rec", setup):
        pass
    assert list(tmp_path.iterdir()) == []
