"""Calibrations of tools with conventions of their own: units, what MATLAB saves, more cameras than two, raw KITTI."""

import struct

import cv2
import numpy as np
import pytest
import scipy.io
from calibration_forms import (
    FISHEYE_CAMERA,
    FORMS,
    K1,
    K2,
    PINHOLE_CAMERA,
    RADTAN,
    SIZE,
    T_RIGHT_LEFT,
    R,
    T,
    matlab,
    multical,
    write,
    zed,
)
from calibrations import StereoCamera

from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.stereo_calibration import read_stereo_calibration


def test_a_stated_unit_gives_way_to_one_that_is_asked_for(tmp_path):
    assert np.linalg.norm(read_stereo_calibration(zed(tmp_path), SIZE)[2][:3, 3]) == pytest.approx(0.12, abs=1e-4)
    in_cm = read_stereo_calibration(zed(tmp_path), SIZE, CalibrationOptions(unit_m=0.01))
    assert np.linalg.norm(in_cm[2][:3, 3]) == pytest.approx(1.2, abs=1e-3)


def opaque() -> bytes:
    """A .mat file whose only variable is an object of a class, as `save` writes stereoParams without toStruct."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    names = b"".join(element(1, name) for name in (b"stereoParams", b"MCOS", b"stereoParameters"))
    numbers = (
        element(6, struct.pack("<II", 13, 0))
        + element(5, struct.pack("<ii", 1, 1))
        + element(1, b"")
        + element(6, struct.pack("<I", 1))
    )
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return header + element(14, flags + names + element(14, numbers))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (opaque(), r"holds objects of MATLAB only; expected a struct: s = toStruct\(stereoParams\); save"),
        (b"\x89HDF\r\n\x1a\n" + bytes(600), r"is of MATLAB's version 7\.3; expected a struct: .* '-v7'"),
        (b"MATLAB 5.0 MAT-file" + bytes(30), "cannot be read: .*; expected a struct"),
    ],
)
def test_what_else_matlab_saves_is_refused_with_the_way_out(tmp_path, content, message):
    (tmp_path / "s.mat").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_stereo_calibration([tmp_path / "s.mat"], SIZE)


def test_a_small_file_of_large_variables_is_refused_unread(tmp_path):
    scipy.io.savemat(tmp_path / "s.mat", {"s": np.zeros(2**21)}, do_compression=True)
    with pytest.raises(InputError, match=r"holds more than 1048576 bytes of variables"):
        read_stereo_calibration([tmp_path / "s.mat"], SIZE)
    np.savez_compressed(tmp_path / "s.npz", K1=np.zeros(2**21), rvecs=np.array([None]))
    with pytest.raises(InputError, match=r"holds no calibration, but nothing; expected one of: .*OpenCV"):
        read_stereo_calibration([tmp_path / "s.npz"], SIZE)


@pytest.mark.parametrize(
    ("form", "old", "new", "message"),
    [
        ("zed", "Baseline=", "X=", r"no Baseline in \[STEREO\]; expected it in mm"),
        ("orb_slam3", "Stereo.T_c1_c2", "T_c1_c2", r"no Stereo\.T_c1_c2; expected settings of a stereo camera"),
        ("orb_slam3", "PinHole", "Omni", r"Camera\.type Omni; expected one of radtan"),
        ("vins", "cam1.yaml", "cam3.yaml", r"cam3\.yaml: cannot be read"),
        ("multical", "cam2_to_cam1", "cam3_to_cam1", "cam3 is 'None'; expected the entries of a camera"),
    ],
)
def test_what_is_missing_is_named(tmp_path, form, old, new, message):
    (file,) = FORMS[form](tmp_path)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_stereo_calibration([file], SIZE)


def test_files_of_two_forms_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"calibration\.json: is of another form than .*SN1\.conf, which is"):
        read_stereo_calibration([*zed(tmp_path), *multical(tmp_path)], SIZE)


def test_of_more_cameras_two_are_chosen(tmp_path):
    """By name, or by their names in the paths of the images; the frame is that of the camera given as left."""
    file = tmp_path / "three.toml"
    (two,) = FORMS["anipose, fisheye"](tmp_path)
    file.write_text(two.read_text() + two.read_text()[: two.read_text().index("[cam_1]")].replace("cam_0", "cam_2"))
    with pytest.raises(InputError, match=r"holds 3 cameras, cam_0, cam_1, cam_2; two are used; expected --cameras"):
        read_stereo_calibration([file], SIZE)
    assert FISHEYE_CAMERA.error_m([file], CalibrationOptions(cameras=("cam_0", "cam_1"))) < 1e-6
    swapped = read_stereo_calibration([file], SIZE, CalibrationOptions(cameras=("cam_1", "cam_0")))
    np.testing.assert_allclose(swapped[2], T_RIGHT_LEFT, atol=1e-9)
    by_path = read_stereo_calibration([file], SIZE, images=(["day/cam_1.mp4"], ["day/cam_0.mp4"]))
    np.testing.assert_allclose(by_path[2], T_RIGHT_LEFT, atol=1e-9)
    file.write_text(
        file.read_text().replace("[cam_0]", '[cam_0]\nname = "A"').replace("[cam_1]", '[cam_1]\nname = "B"')
    )
    by_other_name = read_stereo_calibration([file], SIZE, images=(["vid-B.avi"], ["vid-A.avi"]))
    np.testing.assert_allclose(by_other_name[2], T_RIGHT_LEFT, atol=1e-9)
    assert FISHEYE_CAMERA.error_m([file], CalibrationOptions(cameras=("A", "cam_1"))) < 1e-6
    with pytest.raises(InputError, match="no camera top; expected two of cam_0, cam_1, cam_2"):
        read_stereo_calibration([file], SIZE, CalibrationOptions(cameras=("cam_0", "top")))
    (file,) = matlab(tmp_path)
    with pytest.raises(InputError, match="no camera left; expected no --cameras: it holds two, without names"):
        read_stereo_calibration([file], SIZE, CalibrationOptions(cameras=("left", "right")))


def test_the_raw_file_of_kitti_serves_rectified_and_original_images(tmp_path):
    """By the images' size; rectified by OpenCV, whose left camera is turned by R1."""
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K1, RADTAN[0], K2, RADTAN[1], SIZE, R, T, newImageSize=(1242, 375))
    text = "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\n"
    poses = np.eye(4), T_RIGHT_LEFT
    for k, (K, D, pose, R_rect, P) in enumerate(zip((K1, K2), RADTAN, poses, (R1, R2), (P1, P2), strict=True)):
        rows = {"S": SIZE, "K": K, "D": D, "R": pose[:3, :3], "T": pose[:3, 3], "S_rect": (1242, 375), "R_rect": R_rect}
        for key, numbers in (rows | {"P_rect": P}).items():
            text += f"{key}_0{k}: " + " ".join(repr(float(x)) for x in np.ravel(numbers)) + "\n"
    files = write(tmp_path / "calib_cam_to_cam.txt", text)
    assert PINHOLE_CAMERA.error_m(files) < 1e-6
    rectified = StereoCamera((1242, 375), (P1[:, :3], P2[:, :3]), (np.zeros(5),) * 2, np.eye(4))
    rectified.T_right_left[0, 3] = P2[0, 3] / P2[0, 0]
    assert rectified.error_m(files) < 1e-6
    (folder := tmp_path / "p").mkdir()
    with pytest.raises(InputError, match="holds no projection; expected P1 and P2 with --rectified"):
        read_stereo_calibration(matlab(folder), SIZE, CalibrationOptions(rectified=True))
