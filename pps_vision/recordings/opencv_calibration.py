"""Stereo calibrations made with OpenCV: XML, YAML or JSON files under any of the usual names.

A stereo file tells left from right by its keys (K1, cameraMatrix2, M_left …); a file of one
camera by its file name (left, right), or else by the order in which the files are given.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.calibration import fit_to_images
from pps_vision.recordings.opencv_storage import Entry, Kind, Side, read_entries
from pps_vision.types import Array

_SAME = 1e-6  # difference (relative, or absolute near zero) up to which two files say the same


def read_stereo_calibration(
    paths: Sequence[Path], image_size: tuple[int, int], unit_m: float = 1.0
) -> tuple[Camera, Camera, Array]:
    """(left, right, T_left_right) for images of `image_size` (width, height); root = left camera.

    `unit_m` is the length in metres of the calibration's unit.  OpenCV has p_right = R p_left + T.
    Without R and T, the baseline of a rectification (P1, P2, R1, R2) serves.  Without distortion
    coefficients a lens is taken as free of it.  InputError names the file and what it lacks.
    """
    if not 0 < unit_m < float("inf"):
        raise ValueError(f"unit_m {unit_m}: expected the positive length of the calibration's unit in metres")
    if not paths:
        raise ValueError("no calibration file; expected at least one")
    entries = _assign_sides([read_entries(path) for path in paths])
    left, right = (_camera(paths, entries, side, image_size) for side in ("left", "right"))
    T_right_left = _extrinsics(paths, entries)
    T_right_left[:3, 3] *= unit_m
    return left, right, inverse(T_right_left)


def _assign_sides(files: Sequence[Sequence[Entry]]) -> list[Entry]:
    """All entries, those of one-camera files with the side that the file's name or its place says."""
    one_camera = [entries for entries in files if any(entry.lacks_side for entry in entries)]
    sides = [_side_in_name(entries[0].file) for entries in one_camera]
    free: list[Side] = [side for side in ("left", "right") if side not in sides]
    assigned = [entry for entries in files for entry in entries if not entry.lacks_side]
    for entries, named in zip(one_camera, sides, strict=True):
        if named is None and not free:
            raise InputError(entries[0].file, "is one camera more than two; expected a left and a right one")
        side = named or free.pop(0)
        assigned += [replace(entry, side=side) for entry in entries if entry.lacks_side]
    return assigned


def _side_in_name(file: Path) -> Side | None:
    name = file.name.lower()
    if ("left" in name) == ("right" in name):
        return None
    return "left" if "left" in name else "right"


def _find(entries: Sequence[Entry], kind: Kind, side: Side | None = None, counts: Sequence[int] = ()) -> Entry | None:
    """The entry of a kind; InputError if two disagree, or it has not one of the `counts` of numbers."""
    found = [entry for entry in entries if (entry.kind, entry.side) == (kind, side)]
    for entry in found:
        if counts and len(entry.numbers) not in counts:
            expected = " or ".join(map(str, counts))
            raise InputError(entry.file, f"{entry.key} has {len(entry.numbers)} numbers; expected {expected}")
        if not np.all(np.isfinite(entry.numbers)):
            raise InputError(entry.file, f"{entry.key} holds {entry.numbers.tolist()}; expected finite numbers")
        same_length = len(entry.numbers) == len(found[0].numbers)
        if not same_length or not np.allclose(entry.numbers, found[0].numbers, rtol=_SAME, atol=_SAME):
            what = f"the {side or ''} {kind.value}".replace("  ", " ")
            raise InputError(entry.file, f"{entry.key} is not {found[0].key} of {found[0].file}; expected {what} once")
    return found[0] if found else None


def _camera(paths: Sequence[Path], entries: Sequence[Entry], side: Side, image_size: tuple[int, int]) -> Camera:
    """One eye's camera, fitted to the images."""
    matrix = _find(entries, Kind.K, side, (9,))
    if matrix is None:
        raise InputError(_names(paths), f"no {side} camera matrix; expected one named such as K1, K2 or camera_matrix")
    K = matrix.numbers.reshape(3, 3)
    fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (fx > 0 and fy > 0 and np.allclose(K, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), atol=1e-6 * fx)):
        found = f"{matrix.key} is {np.round(K, 3).tolist()}"
        raise InputError(matrix.file, f"{found}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0")
    lens = _find(entries, Kind.DISTORTION, side)
    coefficients = np.zeros(5) if lens is None else np.append(lens.numbers, np.zeros(5))
    if lens is not None and np.any(coefficients[5:] != 0):
        found = f"{lens.key} has {len(lens.numbers)} coefficients"
        raise InputError(lens.file, f"{found}; expected none but k1, k2, p1, p2, k3 other than zero")
    k1, k2, p1, p2, k3 = (float(value) for value in coefficients[:5])
    width, height = _calibrated_size(entries, matrix.file) or image_size
    return fit_to_images(Camera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3)), image_size, matrix.file)


def _calibrated_size(entries: Sequence[Entry], file: Path) -> tuple[int, int] | None:
    """The image size (width, height) the calibration states: in the camera's own file, or else in another."""
    own = [entry for entry in entries if entry.file == file]
    for group in (own, entries):
        size = _find(group, Kind.SIZE, None, (2,))
        width, height = _find(group, Kind.WIDTH, None, (1,)), _find(group, Kind.HEIGHT, None, (1,))
        numbers = size.numbers if size else np.concatenate([e.numbers for e in (width, height) if e] or [np.zeros(0)])
        if len(numbers) == 2:
            if not np.all((numbers >= 1) & (numbers == np.floor(numbers))):
                raise InputError(file, f"image size {numbers.tolist()}; expected a width and a height in whole pixels")
            return int(numbers[0]), int(numbers[1])
    return None


def _extrinsics(paths: Sequence[Path], entries: Sequence[Entry]) -> Array:
    """`T_right_left` in the calibration's unit: from R and T, or else from a rectification."""
    R, T = _find(entries, Kind.R, None, (9,)), _find(entries, Kind.T, None, (3,))
    P_right = _find(entries, Kind.P, "right", (12,))
    if T is not None and np.any(T.numbers != 0):
        if R is None:
            raise InputError(T.file, f"{T.key} without a rotation; expected R and T")
        return transform(_rotation(R), T.numbers)
    if P_right is None or not (np.all(P_right.numbers[[0, 5]] > 0) and np.any(P_right.numbers[[3, 7]] != 0)):
        raise InputError(_names(paths), "no baseline between the cameras; expected R and T, or P1 and P2")
    P = P_right.numbers
    # the rectified cameras differ by a shift alone: p_rectified_right = p_rectified_left + shift
    shift = transform(None, (P[3] / P[0], P[7] / P[5], 0.0))
    R_left, R_right = (_find(entries, Kind.RECTIFY, side, (9,)) for side in ("left", "right"))
    T_rectified_left = transform(_rotation(R_left) if R_left else None)
    T_rectified_right = transform(_rotation(R_right) if R_right else None)
    return inverse(T_rectified_right) @ shift @ T_rectified_left


def _rotation(entry: Entry) -> Array:
    R = entry.numbers.reshape(3, 3)
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
        raise InputError(entry.file, f"{entry.key} is {np.round(R, 3).tolist()}; expected a rotation matrix")
    return R


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(map(str, paths))
