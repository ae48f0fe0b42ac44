"""Kalibr's camchain: cam0, cam1, … with T_cn_cnm1, the pose of the camera before in each one's frame; in m."""

import re
from collections.abc import Sequence

import numpy as np

from pps_vision.errors import InputError
from pps_vision.recordings.calibrations import CalibratedCamera, camera_matrix, lens_of, size_of
from pps_vision.recordings.documents import Document
from pps_vision.types import Array

FORM = "Kalibr's camchain"
_NAME = re.compile(r"cam[0-9]{1,3}")


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "cam0" in document and "cam1" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all files."""
    cameras: list[CalibratedCamera] = []
    for document in documents:
        pose = np.eye(4)
        for name in sorted(filter(_NAME.fullmatch, document.content), key=lambda name: int(name[3:])):
            table = document.table(name)
            if cameras:
                pose = table.numbers("T_cn_cnm1", 4, 4) @ pose
            cameras.append(pinhole_camera(table, name, pose))
    return cameras


def pinhole_camera(table: Document, name: str, pose: Array) -> CalibratedCamera:
    """A camera with the entries that Kalibr and EuRoC share."""
    if (model := table.word("camera_model", "pinhole")) != "pinhole":
        raise InputError(table.file, f"camera_model {model}; expected pinhole")
    K = camera_matrix(table.numbers("intrinsics", 4))
    D = table.numbers("distortion_coeffs" if "distortion_coeffs" in table else "distortion_coefficients")
    lens = lens_of(table, "distortion_model")
    table.numbers("resolution", 2)
    return CalibratedCamera(table.file, name, K, D, lens, size_of(table, "resolution"), pose)
