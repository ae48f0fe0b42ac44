"""One stereo camera in the calibration file of every tool, written as the tool does or its documentation says.

Each writer takes an empty folder and returns the files, the left camera's first.
"""

import json
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import scipy.io
from calibrations import StereoCamera, store

SIZE = (1280, 720)
K1, K2 = (np.array([[f, 0, 640.5], [0, f + 4, 352.0], [0, 0, 1]]) for f in (700.0, 690.0))
RADTAN = np.array([-0.17, 0.03, 0.0002, -0.0003, 0.001]), np.array([-0.16, 0.02, -0.0001, 0.0004, 0.002])
FOUR = RADTAN[0][:4], RADTAN[1][:4]
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
WITHOUT_K3 = StereoCamera(SIZE, (K1, K2), FOUR, T_RIGHT_LEFT)
RECTIFIED = StereoCamera(SIZE, (K1, K1), (np.zeros(5),) * 2, np.eye(4) + np.outer([1, 0, 0, 0], [0, 0, 0, -0.12]))

ROS_KEYS = {
    **{"camera_matrix": "K", "distortion_coefficients": "D"},
    **{"rectification_matrix": "R", "projection_matrix": "P"},
}


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


def vins(folder: Path, model: str, lenses: Sequence[np.ndarray], names: Sequence[str]) -> list[Path]:
    """The configuration names the cameras' files, which are beside it."""
    focal, section = ("mu", "mv", "u0", "v0"), ""
    if model == "PINHOLE":
        focal, section = ("fx", "fy", "cx", "cy"), "distortion_parameters:\n"
    poses = ""
    for k, (K, D, T_body) in enumerate(zip((K1, K2), lenses, (T_BODY_LEFT, T_BODY_RIGHT), strict=True)):
        text = f"%YAML:1.0\n---\nmodel_type: {model}\nimage_width: 1280\nimage_height: 720\nprojection_parameters:\n"
        text += entries(focal, intrinsics(K), "   {}: {}\n") + section + entries(names, D, "   {}: {}\n")
        write(folder / f"cam{k}.yaml", text)
        poses += f'cam{k}_calib: "cam{k}.yaml"\n' + matrix(f"body_T_cam{k}", T_body)
    return write(folder / "config.yaml", f"%YAML:1.0\nimu: 0\nnum_of_cam: 2\n{poses}max_cnt: 150\n")


def kalibr(folder: Path, model: str, lenses: Sequence[np.ndarray]) -> list[Path]:
    text = ""
    for k, (K, D) in enumerate(zip((K1, K2), lenses, strict=True)):
        text += f"cam{k}:\n  camera_model: pinhole\n  distortion_coeffs: {D.tolist()}\n  distortion_model: {model}\n"
        text += f"  intrinsics: {intrinsics(K)}\n  resolution: [1280, 720]\n  rostopic: /cam{k}/image_raw\n"
    rows = "".join(f"  - {row.tolist()}\n" for row in T_RIGHT_LEFT)
    return write(folder / "camchain.yaml", f"{text}  T_cn_cnm1:\n{rows}")


def euroc(folder: Path) -> list[Path]:
    for k, (T_BS, K, D) in enumerate(zip((T_BODY_LEFT, T_BODY_RIGHT), (K1, K2), FOUR, strict=True)):
        data = ",\n         ".join(str(row.tolist())[1:-1] for row in T_BS)
        (folder / f"{k}.yaml").write_text(
            f"# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam{k} (MT9M034)\n\n"
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\nrate_hz: 20\nresolution: [1280, 720]\n"
            f"camera_model: pinhole\nintrinsics: {intrinsics(K)} #fu, fv, cu, cv\n"
            f"distortion_model: radial-tangential\ndistortion_coefficients: {D.tolist()}\n"
        )
    return [folder / "0.yaml", folder / "1.yaml"]


def ros(folder: Path) -> list[Path]:
    """camera_calibration's files, rectified by OpenCV itself."""
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K1, RADTAN[0], K2, RADTAN[1], SIZE, R, T)
    for name, *matrices in (("left", K1, RADTAN[0][None], R1, P1), ("right", K2, RADTAN[1][None], R2, P2)):
        text = f"image_width: 1280\nimage_height: 720\ncamera_name: {name}\ndistortion_model: plumb_bob\n"
        for key, M in zip(ROS_KEYS, matrices, strict=True):
            text += f"{key}:\n  rows: {M.shape[0]}\n  cols: {M.shape[1]}\n  data: {M.ravel().tolist()}\n"
        (folder / f"{name}.yaml").write_text(text)
    return [folder / "left.yaml", folder / "right.yaml"]


def rostopic(folder: Path) -> list[Path]:
    """The messages as `rostopic echo -n 1` prints them."""
    files = ros(folder)
    for file in files:
        text = 'header: \n  seq: 1\n  frame_id: x\nheight: 720\nwidth: 1280\ndistortion_model: "plumb_bob"\n'
        for key, name in ROS_KEYS.items():
            text += f"{name}: {re.search(rf'{key}:.*?data: (.*?)$', file.read_text(), re.DOTALL | re.MULTILINE)[1]}\n"
        zeros = "".join(f"  {name}: 0\n" for name in ("x_offset", "y_offset", "height", "width"))
        file.write_text(f"{text}binning_x: 0\nbinning_y: 0\nroi: \n{zeros}  do_rectify: False\n---\n")
    return files


def camera_tables(
    folder: Path,
    names: tuple[str, str] = ("cam_0", "cam_1"),
    lenses: Sequence[np.ndarray] = RADTAN,
    matrix: bool = False,
    more: str = "",
) -> list[Path]:
    """Tables of aniposelib and its descendants, whose world is the body; a rotation is a vector or a `matrix`."""
    text = "CreationDate = 2024-01-01T00:00:00\n"
    for name, pose, K, D in zip(names, (T_BODY_LEFT, T_RIGHT_LEFT @ T_BODY_LEFT), (K1, K2), lenses, strict=True):
        turn = pose[:3, :3] if matrix else cv2.Rodrigues(pose[:3, :3])[0].ravel()
        text += f"[{name}]\nport = 1\n{more}size = [ 1280, 720,]\nmatrix = {K.tolist()}\nrotation = {turn.tolist()}\n"
        text += f"distortions = {D.tolist()}\ntranslation = {pose[:3, 3].tolist()}\n"
    return write(folder / "calibration.toml", text + "[charuco]\ncolumns = 4\n[spare]\nmatrix = []\n")


def named(folder: Path, names: tuple[str, str, str, str], sides: Sequence[str], suffix: str) -> list[Path]:
    """OpenCV's K, D, R and T under other names; as OpenCV stores them, or as arrays of NumPy or MATLAB."""
    entries = dict(zip(names[2:], (R, T[:, None]), strict=True))
    for side, K, D in zip(sides, (K1, K2), RADTAN, strict=True):
        entries |= {names[0].format(side): K, names[1].format(side): D[None]}
    file = folder / f"calibration.{suffix}"
    if suffix == "npz":
        np.savez(file, **entries, imageSize=SIZE, **({} if sides == "12" else {"rvecs": np.array([None, 1])}))
    elif suffix == "mat":
        scipy.io.savemat(file, entries)
    else:
        store(file, **entries)
    return [file]


def samples(folder: Path) -> list[Path]:
    """intrinsics.yml and extrinsics.yml of OpenCV's sample stereo_calib."""
    R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(K1, RADTAN[0], K2, RADTAN[1], SIZE, R, T)
    intrinsics = store(folder / "intrinsics.yml", M1=K1, D1=RADTAN[0], M2=K2, D2=RADTAN[1])
    return [intrinsics, store(folder / "extrinsics.yml", R=R, T=T, R1=R1, R2=R2, P1=P1, P2=P2, Q=Q)]


def nested(folder: Path) -> list[Path]:
    """A table for each side and one for the pose."""
    sides = {
        side: {"camera_matrix": K.tolist(), "dist_coeffs": D.tolist()}
        for side, K, D in zip(("left", "right"), (K1, K2), RADTAN, strict=True)
    }
    return write(folder / "calibration.json", json.dumps(sides | {"stereo": {"R": R.tolist(), "T": T.tolist()}}))


OPENCV = ("K{}", "D{}", "R", "T")
MATLAB = ("intrinsicMatrix{}", "distortionCoefficients{}", "rotationOfCamera2", "translationOfCamera2")
NAMED = {  # names of K, D, R and T, and of the sides; kind of file
    **{suffix: (OPENCV, "12", suffix) for suffix in ("xml", "yml", "json", "npz")},
    "documentation": (("cameraMatrix{}", "distCoeffs{}", "R", "T"), "12", "yml"),
    "cameras": (("cam{}_K", "cam{}_distortion_coeffs", "rot_mat", "tvec"), "12", "yml"),
    "npz from 0": (("K{}", "dist_{}", "rotation_matrix", "translation_vector"), "01", "npz"),
    "letters": (("mtx{}", "dist{}", "Rot", "Trans"), "LR", "npz"),
    "words": (("{}_camera_matrix", "{}_distortion", "R", "T"), ("left", "right"), "json"),
    "mat": (MATLAB, "12", "mat"),
}
RADIAL_TANGENTIAL = ("k1", "k2", "p1", "p2", "k3")
OF_PINHOLE = {
    **{form.__name__: form for form in (zed, matlab, matlab_fields, multical, ros, rostopic, samples, nested)},
    **{name: partial(named, names=names, sides=sides, suffix=suffix) for name, (names, sides, suffix) in NAMED.items()},
    "orb_slam3": partial(orb_slam3, kind="PinHole", lenses=RADTAN, names=RADIAL_TANGENTIAL),
    "anipose": partial(camera_tables, more='name = "A"\n'),
    "caliscope": partial(camera_tables, names=("cameras.1", "cameras.2")),
    "caliscope, matrices": partial(camera_tables, names=("cam_1", "cam_2"), matrix=True),
}
OF_FISHEYE = {
    **{form.__name__: form for form in (zed_fisheye, zed_opencv)},
    "kalibr, fisheye": partial(kalibr, model="equidistant", lenses=FISHEYE),
    "orb_slam3, fisheye": partial(orb_slam3, kind="KannalaBrandt8", lenses=FISHEYE, names=("k1", "k2", "k3", "k4")),
    "vins, fisheye": partial(vins, model="KANNALA_BRANDT", lenses=FISHEYE, names=("k2", "k3", "k4", "k5")),
    "anipose, fisheye": partial(camera_tables, lenses=FISHEYE, more="fisheye = true\n"),
}
OF_FOUR = {
    "kalibr": partial(kalibr, model="radtan", lenses=FOUR),
    "euroc": euroc,
    "pose2sim": partial(camera_tables, names=("Miqus_26587", "Miqus_28440"), lenses=FOUR),
    "vins": partial(vins, model="PINHOLE", lenses=FOUR, names=RADIAL_TANGENTIAL[:4]),
}
CASES: dict[str, tuple[Callable[[Path], list[Path]], StereoCamera]] = {
    **{name: (form, PINHOLE_CAMERA) for name, form in OF_PINHOLE.items()},
    **{name: (form, FISHEYE_CAMERA) for name, form in OF_FISHEYE.items()},
    **{name: (form, WITHOUT_K3) for name, form in OF_FOUR.items()},
    "rectified": (partial(orb_slam3, kind="Rectified", lenses=RADTAN, names=RADIAL_TANGENTIAL), RECTIFIED),
}
"""Each form, and the camera that it describes."""
FORMS = {name: form for name, (form, _) in CASES.items()}
