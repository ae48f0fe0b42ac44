"""MATLAB's toStruct(stereoParams) in a .mat or JSON file, in the unit of its board.

Its vectors are rows: IntrinsicMatrix and RotationOfCamera2 are transposed, and its first pixel is (1, 1).
"""

from collections.abc import Sequence

import numpy as np

from pps_vision.geometry.se3 import transform
from pps_vision.recordings.calibrations import CalibratedCamera
from pps_vision.recordings.documents import Document
from pps_vision.types import Array

FORM = "MATLAB's toStruct(stereoParams)"
_UNITS_M = {"mm": 0.001, "millimeters": 0.001, "cm": 0.01, "centimeters": 0.01, "in": 0.0254, "inches": 0.0254}


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return _stereo_parameters(document) is not None


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """Both cameras."""
    stereo = _stereo_parameters(documents[0]) or documents[0]
    R = stereo.numbers("RotationOfCamera2", 3, 3).T
    poses = np.eye(4), transform(R, stereo.numbers("TranslationOfCamera2", 3))
    return [_camera(stereo.table(f"CameraParameters{k}"), pose) for k, pose in enumerate(poses, start=1)]


def _stereo_parameters(document: Document) -> Document | None:
    """The structure, or the variable that holds it."""
    candidates = [document, *document.tables().values()]
    return next((table for table in candidates if "CameraParameters1" in table), None)


def _camera(table: Document, pose: Array) -> CalibratedCamera:
    K = table.numbers("K" if "K" in table else "IntrinsicMatrix", 3, 3)
    K = K if K[2, 2] == 1 and not K[2, :2].any() else K.T
    K = K - np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    k1, k2, *k3 = table.numbers("RadialDistortion").tolist()
    D = np.array([k1, k2, *table.numbers("TangentialDistortion", 2), *k3])
    rows_columns = table.numbers("ImageSize") if "ImageSize" in table else np.zeros(0)
    size = (float(rows_columns[1]), float(rows_columns[0])) if rows_columns.size == 2 else None
    unit_m = _UNITS_M.get(table.word("WorldUnits"))
    return CalibratedCamera(table.file, "", K, D, "radtan", size, pose, unit_m=unit_m)
