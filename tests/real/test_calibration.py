"""Calibrations and image sequences that others recorded."""

import json

import cv2
import numpy as np
import pytest
from data import shared_data

from pps_vision.app.cli import main
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE

BASEBALL = ("calibration_left_final.xml", "calibration_right_final.xml", "calibration_stereo_final.xml")


def baseball(*names: str) -> list:
    return [shared_data("baseball", name) for name in names]


def test_the_robots_own_file_holds_the_eyes_we_carry():
    assert read_icub_eyes(shared_data("icub_files", "icubEyes.ini")) == (LEFT_EYE, RIGHT_EYE)


def test_baseball_agrees_with_its_own_fundamental_matrix():
    left, right, T_left_right = read_stereo_calibration(
        baseball(*BASEBALL), (640, 480), CalibrationOptions(unit_m=0.01)
    )
    storage = cv2.FileStorage(str(shared_data("baseball", BASEBALL[2])), cv2.FILE_STORAGE_READ)
    F = storage.getNode("F").mat()
    view = StereoRig.fixed(left, right, T_left_right).view()
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.2, 0.4, 50), rng.uniform(-0.2, 0.2, 50), rng.uniform(1.5, 6, 50)])
    # F holds between pixels without distortion
    in_right = (points - view.right.center) @ view.right.T_root_camera[:3, :3]
    pixels = [p @ camera.K.T / p[:, 2:] for camera, p in ((left, points), (right, in_right))]
    lines = pixels[0] @ F.T
    distance_px = np.sum(pixels[1] * lines, axis=1) / np.linalg.norm(lines[:, :2], axis=1)
    np.testing.assert_allclose(distance_px, 0, atol=0.01)


def test_baseball_images_pair_by_number():
    folder = shared_data("baseball")
    recording = open_stereo_images([str(folder / "1L*.jpg")], [str(folder / "1R*.jpg")], fps=30)
    frames = list(recording.numbered())
    assert ([number for number, _ in frames], recording.problems) == (list(range(5, 41)), [])
    for _, frame in frames:  # grey, replicated
        assert np.all(frame.left == frame.left[..., :1])


def test_a_calibration_made_here_from_chessboards_is_read(tmp_path):
    """OpenCV's own stereoCalibrate and epipolar lines against our cameras, on real corners."""
    folder = shared_data("chessboards")
    board = np.zeros((54, 3), np.float32)
    board[:, :2] = np.mgrid[:9, :6].T.reshape(-1, 2)
    recording = open_stereo_images([str(folder / "left*.jpg")], [str(folder / "right*.jpg")], fps=1)
    corners = [
        [
            cv2.findChessboardCorners(np.ascontiguousarray(image[..., 0]), (9, 6))[1]
            for image in (frame.left, frame.right)
        ]
        for frame in recording
    ]
    corners = [pair for pair in corners if pair[0] is not None and pair[1] is not None]
    assert len(corners) >= 10
    left_px, right_px = zip(*corners, strict=True)
    boards = [board] * len(corners)
    size = recording.image_size
    singles = [cv2.calibrateCamera(boards, px, size, None, None)[1:3] for px in (left_px, right_px)]
    flags = cv2.CALIB_FIX_INTRINSIC
    _, K1, D1, K2, D2, R, T, *_ = cv2.stereoCalibrate(
        boards, left_px, right_px, *singles[0], *singles[1], size, flags=flags
    )
    storage = cv2.FileStorage(str(tmp_path / "stereo.xml"), cv2.FILE_STORAGE_WRITE)
    for key, value in {"M1": K1, "D1": D1, "M2": K2, "D2": D2, "R": R, "T": T}.items():
        storage.write(key, value)
    storage.release()

    left, right, T_left_right = read_stereo_calibration(
        [tmp_path / "stereo.xml"], size, CalibrationOptions(unit_m=0.025)
    )
    assert np.linalg.norm(T_left_right[:3, 3]) == pytest.approx(3.33 * 0.025, rel=0.01)  # squares, as others measured
    view = StereoRig.fixed(left, right, T_left_right).view()
    ok, rotation, shift = cv2.solvePnP(board * 0.025, left_px[0], K1, D1)
    assert ok
    in_left = (board * 0.025) @ cv2.Rodrigues(rotation)[0].T + shift[:, 0]
    error_px = np.linalg.norm(view.right.project(in_left) - right_px[0][:, 0], axis=1)
    assert np.sqrt(np.mean(error_px**2)) < 1.0


def test_the_command_calibrates_real_chessboards(tmp_path, capsys):
    """Squares as the unit of length; others measured a stereo RMS of 0.217 px and a baseline of 3.33 squares."""
    folder = shared_data("chessboards")
    images = ["--left", str(folder / "left*.jpg"), "--right", str(folder / "right*.jpg")]
    main(["calibrate", *images, "--board", "9", "6", "--square-mm", "1000", "--out", str(tmp_path / "out")])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["pairs"] == 13
    assert summary["rms_px"]["stereo"] <= 0.25
    assert summary["baseline_mm"] == pytest.approx(3330, rel=0.01)
