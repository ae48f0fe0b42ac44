"""Stereo calibrations: OpenCV's file storage (XML, YAML or JSON), and what `calibration_files` reads.

| key | holds |
|---|---|
| `K1` or `M1`, `D1` | camera matrix (3×3) and distortion (k1, k2, p1, p2, k3) of the left camera |
| `K2` or `M2`, `D2` | the same of the right camera |
| `camera_matrix` or `intrinsic`, `distortion_coefficients` or `distortion` | the same in a file of one camera |
| `R`, `T` | pose of the left camera's frame in the right camera's: p_right = R p_left + T |
| `image_width`, `image_height` | optional: the image size that the camera matrices are for |

These are the keys of OpenCV's samples stereo_calib and calibration; other keys are ignored.  Of the files of one
camera the first is the left one.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.files import read_bytes
from pps_vision.geometry.camera import Camera
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.calibration_files import numbers_of, read_matrices
from pps_vision.recordings.file_storage import read_file_storage
from pps_vision.recordings.icub_eyes import LARGEST_SIDE_PX, fit_to_images
from pps_vision.types import Array

_KEYS = {
    **{f"{name}{side}": f"K{side}" for name in "KM" for side in "12"},
    **{name: name for name in ("D1", "D2", "R", "T", "image_width", "image_height")},
    **{"camera_matrix": "K", "intrinsic": "K", "distortion_coefficients": "D", "distortion": "D"},
}
_OF_ONE_CAMERA = ("K", "D", "image_width", "image_height", "pose")

_NODE = re.compile(r"[\[{:]|-\s|<(?![/!?])")  # what may open one in YAML, JSON or XML
_MOST_NODES = 2000
_MOST_CHARACTERS = 2**22

Entry = tuple[Path, Array]
"""A matrix and the file that it is from."""


def read_stereo_calibration(
    paths: Sequence[Path],
    image_size: tuple[int, int],
    unit_m: float = 1.0,
    kitti: tuple[int, int] = (0, 1),
    warnings: list[str] | None = None,
) -> tuple[Camera, Camera, Array]:
    """Left camera, right camera and `T_left_right` of a calibration; the root frame is the left camera's.

    InputError if a file cannot be read, or a matrix is missing or invalid.

    Args:
        paths: The files, which together hold the keys above.
        image_size: Width and height of the images, to which the cameras are scaled.
        unit_m: Metres per length unit of the calibration.
        kitti: Which of KITTI's cameras are left and right.
        warnings: Here is noted that the cameras are scaled.
    """
    return cameras_of([(path, _read(path, kitti)) for path in paths], image_size, unit_m, warnings)


def cameras_of(
    files: Sequence[tuple[Path, Mapping[str, Array]]],
    image_size: tuple[int, int],
    unit_m: float = 1.0,
    warnings: list[str] | None = None,
) -> tuple[Camera, Camera, Array]:
    """The same of matrices that have been read, with the file that each is from."""
    if not 0 < unit_m < float("inf"):
        raise InputError("calibration", f"unit_m {unit_m}; expected the positive length of the unit in metres")
    entries: dict[str, Entry] = {}
    sides = ["1", "2"]
    for path, entry in files:
        if "K" in entry:
            if not sides:
                raise InputError(path, "is one camera more than two; expected a left and a right one")
            side = sides.pop(0)
            entry = {key + side * (key in _OF_ONE_CAMERA): value for key, value in entry.items()}
        entries |= {key: (path, value) for key, value in entry.items()}
    names = ", ".join(dict.fromkeys(str(path) for path, _ in files))
    left, right = (_camera(names, entries, side, image_size, warnings) for side in ("1", "2"))
    if "pose1" in entries and "pose2" in entries:
        T_right_left = entries["pose2"][1] @ inverse(entries["pose1"][1])
        file = entries["pose2"][0]
        entries |= {"R": (file, T_right_left[:3, :3]), "T": (file, T_right_left[:3, 3])}
    R, T = (_required(names, entries, key, shape) for key, shape in (("R", (3, 3)), ("T", (3,))))
    if not np.allclose(R[1] @ R[1].T, np.eye(3), atol=1e-3) or np.linalg.det(R[1]) < 0:
        raise InputError(R[0], f"R is {np.round(R[1], 3).tolist()}; expected a rotation matrix")
    if not T[1].any():
        raise InputError(T[0], "T is 0; expected the vector between two cameras")
    T_left_right = inverse(transform(R[1], unit_m * T[1]))
    baseline_m = np.abs(T_left_right[:3, 3]).max()
    if not 1e-5 <= baseline_m <= 1e4:  # products of larger or smaller numbers leave the range of doubles
        raise InputError(T[0], f"the cameras are {baseline_m:.3g} m apart; expected 0.01 mm to 10 km")
    return left, right, T_left_right


def _read(file: Path, kitti: tuple[int, int]) -> dict[str, Array]:
    """The matrices of one file, by key."""
    text = read_bytes(file, "a calibration").decode("utf-8-sig", errors="replace")
    if (others := read_matrices(file, text[: _MOST_CHARACTERS + 1], kitti)) is not None:
        return others
    if len(text) > _MOST_CHARACTERS or len(_NODE.findall(text)) > _MOST_NODES:
        too_much = f"has more than {_MOST_CHARACTERS} characters or {_MOST_NODES} nodes"
        raise InputError(file, f"{too_much}; expected an OpenCV calibration")
    content = read_file_storage(file, text, _KEYS)
    entry = {_KEYS[name]: numbers_of(file, content, name) for name in content}
    if not entry:
        raise InputError(file, f"holds no calibration; expected one of the keys {', '.join(_KEYS)}")
    return entry


def _required(names: str, entries: Mapping[str, Entry], key: str, shape: tuple[int, ...]) -> Entry:
    """The matrix of a key, reshaped."""
    if key not in entries:
        raise InputError(names, f"no {key}; expected K1, D1, K2, D2, R and T, or two cameras with their poses")
    file, matrix = entries[key]
    if matrix.size != np.prod(shape):
        raise InputError(file, f"{key} has {matrix.size} numbers; expected {np.prod(shape)}")
    return file, matrix.reshape(shape)


def _camera(
    names: str, entries: Mapping[str, Entry], side: str, image_size: tuple[int, int], warnings: list[str] | None
) -> Camera:
    """One camera, scaled to the images; without D its lens has no distortion."""
    file, K = _required(names, entries, f"K{side}", (3, 3))
    fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (fx > 0 and fy > 0 and np.allclose(K, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), atol=1e-6 * fx)):
        entry = f"K{side} is {np.round(K, 3).tolist()}"
        raise InputError(file, f"{entry}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0")
    coefficients = np.append(entries.get(f"D{side}", (file, np.zeros(0)))[1], np.zeros(5))
    if np.any(coefficients[5:] != 0):
        entry = f"D{side} is {str(coefficients[:-5].tolist())[:80]}"
        raise InputError(entries[f"D{side}"][0], f"{entry}; expected none but k1, k2, p1, p2, k3 other than zero")
    k1, k2, p1, p2, k3 = coefficients[:5].tolist()
    width, height = (
        entries.get(name + side, entries.get(name, (file, np.array(size))))[1].item()
        for name, size in zip(("image_width", "image_height"), image_size, strict=True)
    )
    if not all(1 <= size <= LARGEST_SIDE_PX and float(size).is_integer() for size in (width, height)):
        entry = f"image_width {width}, image_height {height}"
        raise InputError(file, f"{entry}; expected whole numbers of pixels, at most {LARGEST_SIDE_PX}")
    camera = Camera(int(width), int(height), fx, fy, cx, cy, (k1, k2, p1, p2, k3))
    fitted = fit_to_images(camera, image_size, file)
    entry = f"{file} is for {camera.width}×{camera.height} pixels, scaled to images of {fitted.width}×{fitted.height}"
    if warnings is not None and fitted is not camera and entry not in warnings:
        warnings.append(entry)
    return fitted
