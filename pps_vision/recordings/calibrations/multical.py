"""multical's calibration.json: cameras, and camera_poses, p_camera = R p_master + T; in the unit of its board."""

from collections.abc import Sequence

from pps_vision.geometry.se3 import transform
from pps_vision.recordings.calibrations import CalibratedCamera, lens_of, size_of
from pps_vision.recordings.documents import Document

FORM = "multical's calibration.json"


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "cameras" in document and "camera_poses" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """All cameras with a pose."""
    cameras = []
    for name_to_master, pose in documents[0].table("camera_poses").tables().items():
        name = name_to_master.partition("_to_")[0]
        table = documents[0].table("cameras").table(name)
        T_camera_master = transform(pose.numbers("R", 3, 3), pose.numbers("T", 3))
        K, D, lens = table.numbers("K", 3, 3), table.numbers("dist"), lens_of(table, "model", "standard")
        cameras.append(CalibratedCamera(table.file, name, K, D, lens, size_of(table, "image_size"), T_camera_master))
    return cameras
