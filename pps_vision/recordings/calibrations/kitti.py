"""KITTI's calib.txt and calib_cam_to_cam.txt: the projections of rectified cameras, named after their folders; in m.

The raw recordings' file also holds the cameras of unrectified images (`K_00`, `D_00`, `R_00`, `T_00`, `S_00`).
"""

import re
from collections.abc import Sequence
from dataclasses import replace

from pps_vision.geometry.se3 import transform
from pps_vision.recordings.calibrations import CalibratedCamera, rectified_camera, size_of
from pps_vision.recordings.documents import Document

FORM = "KITTI's calib.txt"
_PROJECTION = re.compile(r"P(_rect_)?([0-9]{1,2})")


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "P0" in document or "P_rect_00" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all files."""
    cameras = []
    for document in documents:
        words = {key: str(value).split() for key, value in document.content.items()}
        document = Document(document.file, words)
        for match in filter(None, map(_PROJECTION.fullmatch, words)):
            key, k = match[0], match[2]
            size = size_of(document, f"S_rect_{k}")
            camera = rectified_camera(document.file, f"image_{k}", document.numbers(key, 3, 4), size)
            if f"K_{k}" in document:
                pose = transform(document.numbers(f"R_{k}", 3, 3), document.numbers(f"T_{k}", 3))
                K, D = document.numbers(f"K_{k}", 3, 3), document.numbers(f"D_{k}")
                original = CalibratedCamera(
                    document.file, camera.name, K, D, "radtan", size_of(document, f"S_{k}"), pose
                )
                camera = replace(original, rectified=camera)
            cameras.append(camera)
    return cameras
