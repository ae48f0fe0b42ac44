"""EuRoC's and other ASL sensor.yaml: one camera a file and its pose in the body's frame, T_BS; in m."""

from collections.abc import Sequence

from pps_vision.geometry.se3 import inverse
from pps_vision.recordings.calibrations import CalibratedCamera
from pps_vision.recordings.calibrations.kalibr import pinhole_camera
from pps_vision.recordings.documents import Document

FORM = "EuRoC's sensor.yaml"


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "T_BS" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all files, named after their folders."""
    return [
        pinhole_camera(document, document.file.parent.name, inverse(document.numbers("T_BS", 4, 4)))
        for document in documents
    ]
