"""Calibrations of tools with conventions of their own: units, resolutions, transposed matrices, other names of lenses;
written by code as the tools write them, judged against OpenCV's projections."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io
from calibrations import StereoCamera, store

from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.stereo_calibration import read_stereo_calibration

SIZE = (1280, 720)
K1, K2 = (np.array([[f, 0, 640.5], [0, f + 4, 352.0], [0, 0, 1]]) for f in (700.0, 690.0))
RADTAN = np.array([-0.17, 0.03, 0.0002, -0.0003, 0.001]), np.array([-0.16, 0.02, -0.0001, 0.0004, 0.002])
FISHEYE = np.array([-0.007, 0.042, -0.04, 0.0066]), np.array([-0.006, 0.04, -0.038, 0.006])
ROTATION = np.array([0.004, 0.02, -0.003])
T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3] = cv2.Rodrigues(ROTATION)[0]
T_RIGHT_LEFT[:3, 3] = (-0.12, 0.0005, -0.0008)
T_BODY_LEFT = np.eye(4)
T_BODY_LEFT[:3, :3] = cv2.Rodrigues(np.array([0.4, 1.1, -0.3]))[0]
T_BODY_LEFT[:3, 3] = (0.05, -0.2, 0.3)
T_BODY_RIGHT = T_BODY_LEFT @ np.linalg.inv(T_RIGHT_LEFT)
R, T = T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3]
PINHOLE_CAMERA = StereoCamera(SIZE, (K1, K2), RADTAN, T_RIGHT_LEFT)
FISHEYE_CAMERA = StereoCamera(SIZE, (K1, K2), FISHEYE, T_RIGHT_LEFT, fisheye=True)
WITHOUT_K3 = StereoCamera(SIZE, (K1, K2), tuple(D[:4] for D in RADTAN), T_RIGHT_LEFT)
RECTIFIED = StereoCamera(SIZE, (K1, K1), (np.zeros(5),) * 2, np.eye(4) + np.outer([1, 0, 0, 0], [0, 0, 0, -0.12]))


def entries(names: Sequence[str], values: Sequence[float], form: str = "{}={}\n") -> str:
    return "".join(form.format(name, repr(float(value))) for name, value in zip(names, values, strict=True))


def intrinsics(K: np.ndarray) -> list[float]:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]).tolist()


def write(file: Path, text: str) -> list[Path]:
    file.write_text(text)
    return [file]


def zed(folder: Path) -> list[Path]:
    """A factory's file: the resolution VGA and that of the images."""
    text = ""
    for side, K, D in zip(("LEFT", "RIGHT"), (K1, K2), RADTAN, strict=True):
        for resolution, scale in (("VGA", 0.525), ("HD", 1.0)):
            text += f"[{side}_CAM_{resolution}]\n" + entries(("fx", "fy", "cx", "cy"), scale * np.array(intrinsics(K)))
            text += entries(("k1", "k2", "p1", "p2", "k3"), D) + "\n"
    text += "[STEREO]\n" + entries(("Baseline", "TY", "TZ"), 1000 * T * (-1, 1, 1))
    for resolution in ("VGA", "HD"):
        text += entries([f"{key}_{resolution}" for key in ("RX", "CV", "RZ")], ROTATION)
    return write(folder / "SN1.conf", text)


def zed_fisheye(folder: Path) -> list[Path]:
    """As Stereolabs' calibration tool writes its own: the distortion in a section for all resolutions."""
    text = "[STEREO]\n" + entries(
        ("Baseline", "TY", "TZ", "RX_HD", "CV_HD", "RZ_HD"), [*1000 * T * (-1, 1, 1), *ROTATION]
    )
    for side, K, D in zip(("LEFT", "RIGHT"), (K1, K2), FISHEYE, strict=True):
        text += f"[{side}_CAM_HD]\n" + entries(("fx", "fy", "cx", "cy"), intrinsics(K), "{} = {}\n")
        text += f"[{side}_DISTO]\n" + entries(("k1", "k2", "k3", "k4"), D, "{} = {}\n")
    return write(folder / "SN2.conf", text)


def zed_opencv(folder: Path) -> list[Path]:
    """The same tool's OpenCV file; a rotation vector, and its lens in the name."""
    K, D = (
        dict(zip(("K_LEFT", "K_RIGHT"), (K1, K2), strict=True)),
        dict(zip(("D_LEFT_FE", "D_RIGHT_FE"), FISHEYE, strict=True)),
    )
    return [store(folder / "zed.yml", **K, **D, R=ROTATION, T=T)]


def stereo_parameters(matrix: str) -> dict[str, object]:
    """MATLAB's structure: row vectors, the first pixel is (1, 1), in mm."""
    parameters: dict[str, object] = {"RotationOfCamera2": R.T, "TranslationOfCamera2": 1000 * T}
    for k, (K, D) in enumerate(zip((K1, K2), RADTAN, strict=True), start=1):
        one_based = K + np.outer([1, 1, 0], [0, 0, 1])
        parameters[f"CameraParameters{k}"] = {
            "RadialDistortion": D[[0, 1, 4]],
            "TangentialDistortion": D[2:4],
            "ImageSize": [720.0, 1280.0],
            matrix: one_based if matrix == "K" else one_based.T,
            "WorldUnits": "millimeters",
            "RotationVectors": np.zeros((9, 3)),
        }
    return parameters


def matlab(folder: Path) -> list[Path]:
    scipy.io.savemat(folder / "s.mat", {"s": stereo_parameters("IntrinsicMatrix")}, do_compression=True)
    return [folder / "s.mat"]


def matlab_fields(folder: Path) -> list[Path]:
    """save -struct, of a newer version."""
    scipy.io.savemat(folder / "s.mat", stereo_parameters("K"))
    return [folder / "s.mat"]


def multical(folder: Path) -> list[Path]:
    cameras = {
        name: {"model": "standard", "image_size": SIZE, "K": K.tolist(), "dist": [D.tolist()]}
        for name, K, D in zip(("cam1", "cam2"), (K1, K2), RADTAN, strict=True)
    }
    poses = {"cam1": {"R": np.eye(3).tolist(), "T": [0, 0, 0]}, "cam2_to_cam1": {"R": R.tolist(), "T": T.tolist()}}
    frames = [{"cam1": f"cam1/{k}.png", "cam2": f"cam2/{k}.png"} for k in range(2000)]
    content = {"cameras": cameras, "camera_poses": poses, "image_sets": {"rgb": frames}}
    return write(folder / "calibration.json", json.dumps(content))


def matrix(name: str, T: np.ndarray) -> str:
    return f"{name}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: {T.ravel().tolist()}\n"


def orb_slam3(folder: Path, kind: str, lenses: Sequence[np.ndarray], names: Sequence[str]) -> list[Path]:
    text = f'%YAML:1.0\n\n# Camera\nFile.version: "1.0"\nCamera.type: "{kind}"\n'
    for k, (K, D) in enumerate(zip((K1, K2), lenses, strict=True), start=1):
        text += entries(
            [f"Camera{k}.{key}" for key in ("fx", "fy", "cx", "cy", *names)], [*intrinsics(K), *D], "{}: {}\n"
        )
    text += "Camera.width: 1280\nCamera.height: 720\nCamera.fps: 20\nStereo.ThDepth: 60.0\nStereo.b: 0.12\n"
    data = np.linalg.inv(T_RIGHT_LEFT).ravel().tolist()
    return write(
        folder / "s.yaml", f"{text}Stereo.T_c1_c2: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: f\n  data: {data}\n"
    )


def orb_slam3_pinhole(folder: Path) -> list[Path]:
    return orb_slam3(folder, "PinHole", RADTAN, ("k1", "k2", "p1", "p2", "k3"))


def orb_slam3_fisheye(folder: Path) -> list[Path]:
    return orb_slam3(folder, "KannalaBrandt8", FISHEYE, ("k1", "k2", "k3", "k4"))


def orb_slam3_rectified(folder: Path) -> list[Path]:
    return orb_slam3(folder, "Rectified", RADTAN, ("k1", "k2", "p1", "p2", "k3"))


def vins(folder: Path, model: str, lenses: Sequence[np.ndarray], section: str, names: Sequence[str]) -> list[Path]:
    """The configuration names the cameras' files, which are beside it."""
    focal = ("mu", "mv", "u0", "v0") if model == "KANNALA_BRANDT" else ("fx", "fy", "cx", "cy")
    poses = ""
    for k, (K, D, T_body) in enumerate(zip((K1, K2), lenses, (T_BODY_LEFT, T_BODY_RIGHT), strict=True)):
        text = f"%YAML:1.0\n---\nmodel_type: {model}\nimage_width: 1280\nimage_height: 720\nprojection_parameters:\n"
        text += entries(focal, intrinsics(K), "   {}: {}\n") + section + entries(names, D, "   {}: {}\n")
        write(folder / f"cam{k}.yaml", text)
        poses += f'cam{k}_calib: "cam{k}.yaml"\n' + matrix(f"body_T_cam{k}", T_body)
    return write(folder / "config.yaml", f"%YAML:1.0\nimu: 0\nnum_of_cam: 2\n{poses}max_cnt: 150\n")


def vins_pinhole(folder: Path) -> list[Path]:
    return vins(folder, "PINHOLE", [D[:4] for D in RADTAN], "distortion_parameters:\n", ("k1", "k2", "p1", "p2"))


def vins_fisheye(folder: Path) -> list[Path]:
    return vins(folder, "KANNALA_BRANDT", FISHEYE, "", ("k2", "k3", "k4", "k5"))


def kalibr_fisheye(folder: Path) -> list[Path]:
    text = ""
    for k, (K, D) in enumerate(zip((K1, K2), FISHEYE, strict=True)):
        text += (
            f"cam{k}:\n  camera_model: pinhole\n  distortion_coeffs: {D.tolist()}\n  distortion_model: equidistant\n"
        )
        text += f"  intrinsics: {intrinsics(K)}\n  resolution: [1280, 720]\n"
    return write(folder / "camchain.yaml", f"{text}  T_cn_cnm1: {T_RIGHT_LEFT.tolist()}\n")


def anipose_fisheye(folder: Path) -> list[Path]:
    text = ""
    for k, (K, D, rotation, translation) in enumerate(
        zip((K1, K2), FISHEYE, (np.zeros(3), ROTATION), (np.zeros(3), T), strict=True)
    ):
        text += f"[cam_{k}]\nfisheye = true\nsize = [1280, 720]\nmatrix = {K.tolist()}\ndistortions = {D.tolist()}\n"
        text += f"rotation = {rotation.tolist()}\ntranslation = {translation.tolist()}\n"
    return write(folder / "calibration.toml", text)


PINHOLE_FORMS = (zed, matlab, matlab_fields, multical, orb_slam3_pinhole)
FISHEYE_FORMS = (zed_fisheye, zed_opencv, orb_slam3_fisheye, vins_fisheye, kalibr_fisheye, anipose_fisheye)


@pytest.mark.parametrize(
    ("form", "camera"),
    [
        *((form, PINHOLE_CAMERA) for form in PINHOLE_FORMS),
        *((form, FISHEYE_CAMERA) for form in FISHEYE_FORMS),
        (vins_pinhole, WITHOUT_K3),
        (orb_slam3_rectified, RECTIFIED),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_positions_by_each_tool_are_those_of_opencv_s_projections(tmp_path, form, camera):
    assert camera.error_m(form(tmp_path)) < 1e-6


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
        (zed, "Baseline=", "X=", r"no Baseline in \[STEREO\]; expected it in mm"),
        (orb_slam3_pinhole, "Stereo.T_c1_c2", "T_c1_c2", r"no Stereo\.T_c1_c2; expected settings of a stereo camera"),
        (orb_slam3_pinhole, "PinHole", "Omni", r"Camera\.type Omni; expected one of radtan"),
        (vins_pinhole, "cam1.yaml", "cam3.yaml", r"cam3\.yaml: cannot be read"),
        (multical, "cam2_to_cam1", "cam3_to_cam1", "cam3 is 'None'; expected the entries of a camera"),
    ],
)
def test_what_is_missing_is_named(tmp_path, form, old, new, message):
    (file,) = form(tmp_path)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_stereo_calibration([file], SIZE)


def test_files_of_two_forms_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"calibration\.json: is of another form than .*SN1\.conf, which is"):
        read_stereo_calibration([*zed(tmp_path), *multical(tmp_path)], SIZE)


def test_of_more_cameras_two_are_chosen(tmp_path):
    """By name, or by their names in the paths of the images; the frame is that of the camera given as left."""
    file = tmp_path / "three.toml"
    (two,) = anipose_fisheye(tmp_path)
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
