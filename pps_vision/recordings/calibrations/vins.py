"""VINS-Fusion's configuration: body_T_cam0 and body_T_cam1, with the files of the cameras beside it; in m."""

from collections.abc import Sequence
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse
from pps_vision.recordings.calibrations import CalibratedCamera, camera_matrix, size_of
from pps_vision.recordings.documents import Document, read_document
from pps_vision.types import Array

FORM = "VINS-Fusion's configuration"
_MODELS = {  # names of the focal lengths and the centre, and of the coefficients
    "PINHOLE": (("fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2")),
    "KANNALA_BRANDT": (("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5")),
}


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "body_T_cam0" in document or "projection_parameters" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """Both cameras."""
    main = next((document for document in documents if "body_T_cam0" in document), None)
    if main is None:
        raise InputError(documents[0].file, "is of one camera; expected the configuration with body_T_cam0")
    cameras = []
    for name in ("cam0", "cam1"):
        pose = inverse(main.numbers(f"body_T_{name}", 4, 4))
        camera = read_document(main.file.parent / Path(main.word(f"{name}_calib")).name)
        cameras.append(_camera(camera, name, pose))
    return cameras


def _camera(document: Document, name: str, pose: Array) -> CalibratedCamera:
    if (model := document.word("model_type")) not in _MODELS:
        raise InputError(document.file, f"model_type {model}; expected one of {', '.join(_MODELS)}")
    is_fisheye = model == "KANNALA_BRANDT"
    projection = document.table("projection_parameters")
    lens = projection if is_fisheye else document.table("distortion_parameters")
    focal_center, coefficients = _MODELS[model]
    K, D = camera_matrix(projection.scalars(focal_center)), lens.scalars(coefficients)
    size = size_of(document, "image_width", "image_height")
    return CalibratedCamera(document.file, name, K, D, "fisheye" if is_fisheye else "radtan", size, pose)
