"""Forms of calibrations, one a module, found here without being named elsewhere.

A module has `FORM`, its description; `recognises(document)`; and `read(documents)`, which returns the cameras of all
files of a calibration.  `IS_LAST`: other forms, which are asked first, have its names too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import transform
from pps_vision.recordings import Lens
from pps_vision.recordings.documents import Document
from pps_vision.types import Array

_LENSES: dict[str, Lens] = {
    **dict.fromkeys(("radtan", "radial-tangential", "plumb_bob", "none"), "radtan"),
    **dict.fromkeys(("rational_polynomial", "standard", "rational", "thin_prism", "tilted", "pinhole"), "radtan"),
    **dict.fromkeys(("equidistant", "equi", "fisheye", "kannalabrandt8", "kannala_brandt"), "fisheye"),
}


@dataclass(frozen=True)
class CalibratedCamera:
    """A camera of a calibration.

    Attributes:
        file: The file that it is from.
        name: Its name there, "" where it has none.
        other_name: Another name of it.
        K: (3, 3) camera matrix.
        D: OpenCV's distortion coefficients.
        lens: Their model; None where the form does not state it.
        size: Width and height of the images that it is for, px.
        pose: (4, 4) p_camera = pose p_reference, in the calibration's unit of length.
        unit_m: Metres per unit, where the form states it.
        rectified: The same camera for rectified images.
    """

    file: Path
    name: str
    K: Array
    D: Array
    lens: Lens | None
    size: tuple[float, float] | None
    pose: Array
    other_name: str = ""
    unit_m: float | None = None
    rectified: "CalibratedCamera | None" = None

    def __post_init__(self) -> None:
        R = self.pose[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
            raise InputError(self.file, f"R is {np.round(R, 3).tolist()}; expected a rotation matrix")


def lens_of(document: Document, key: str, default: str = "none") -> Lens:
    """The lens model that an entry names; InputError for another."""
    model = document.word(key, default)
    if (lens := _LENSES.get(model.lower())) is None:
        raise InputError(document.file, f"{key} {model}; expected one of {', '.join(_LENSES)}")
    return lens


def camera_matrix(focal_lengths_center: Array) -> Array:
    """The camera matrix of fx, fy, cx, cy."""
    fx, fy, cx, cy = focal_lengths_center
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def size_of(document: Document, *keys: str) -> tuple[float, float] | None:
    """Width and height: two entries, or two numbers of one; None where there are none."""
    if any(key not in document for key in keys):
        return None
    width, height = np.concatenate([document.numbers(key, 2 // len(keys)) for key in keys]).tolist()
    return width, height


def rotation_of(document: Document, key: str) -> Array:
    """A rotation matrix of 9 numbers, or of a rotation vector's 3."""
    numbers = document.numbers(key)
    if numbers.size == 3:
        return np.asarray(cv2.Rodrigues(numbers)[0])
    return document.numbers(key, 3, 3)


def rectified_camera(file: Path, name: str, P: Array, size: tuple[float, float] | None) -> CalibratedCamera:
    """The camera of a projection [K | K t] of rectified images; InputError for another matrix."""
    if not (P[0, 0] > 0 and P[1, 1] > 0 and P[2, 2] == 1):
        raise InputError(file, f"projection {np.round(P, 3).tolist()}; expected [K | K t] with positive focal lengths")
    z = P[2, 3]
    x, y = (P[:2, 3] - P[:2, 2] * z) / (P[0, 0], P[1, 1])
    pose = transform(None, np.array([x, y, z]))
    return CalibratedCamera(file, name, P[:, :3], np.zeros(0), "radtan", size, pose)


def names_of(cameras: Sequence[CalibratedCamera]) -> str:
    """The names of cameras, for messages."""
    return ", ".join(camera.name for camera in cameras)
