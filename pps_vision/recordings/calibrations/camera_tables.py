"""A table for each camera: matrix, distortions, size, rotation and translation, p_camera = R p_world + t.

Aniposelib, Caliscope and Pose2Sim write them in TOML, and they are the form to write by hand.  The rotation is a vector
of 3 numbers (OpenCV's Rodrigues) or a matrix.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from pps_vision.geometry.se3 import transform
from pps_vision.recordings import Lens
from pps_vision.recordings.calibrations import CalibratedCamera, rotation_of, size_of
from pps_vision.recordings.documents import Document

FORM = "a table a camera with matrix, rotation, translation (aniposelib, Caliscope, Pose2Sim, by hand)"


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return any(_cameras(document))


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all files."""
    return [_camera(name, table) for document in documents for name, table in _cameras(document)]


def _cameras(document: Document) -> Iterator[tuple[str, Document]]:
    """The tables of cameras that have a pose, at any depth, with their names."""
    for name, table in document.tables().items():
        if "matrix" in table:
            if "rotation" in table or "translation" in table:
                yield name, table
        else:
            yield from _cameras(table)


def _camera(name: str, table: Document) -> CalibratedCamera:
    pose = transform(rotation_of(table, "rotation"), table.numbers("translation", 3))
    K = table.numbers("matrix", 3, 3)
    D = table.numbers("distortions") if "distortions" in table else np.zeros(0)
    is_fisheye = table.word("fisheye").lower() == "true"
    size = size_of(table, "size")
    lens: Lens = "fisheye" if is_fisheye else "radtan"
    return CalibratedCamera(table.file, name, K, D, lens, size, pose, other_name=table.word("name"))
