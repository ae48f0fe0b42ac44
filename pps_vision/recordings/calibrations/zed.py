"""Stereolabs' SN….conf of a ZED: both cameras at each resolution, and their pose, in mm.

As Stereolabs' own tool (zedx-one-capture) writes it: p_right = R p_left + T with the rotation vector (RX, CV, RZ) and
T = (-Baseline, TY, TZ).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import transform
from pps_vision.recordings import Lens
from pps_vision.recordings.calibrations import CalibratedCamera, camera_matrix
from pps_vision.recordings.documents import Document

FORM = "Stereolabs' SN….conf"
_SIZES = {
    **{"2K": (2208, 1242), "FHD": (1920, 1080), "HD": (1280, 720), "VGA": (672, 376)},
    **{"FHD1200": (1920, 1200), "SVGA": (960, 600), "4k": (3840, 2160), "QHDPLUS": (3200, 1800)},
}
_RADIAL_TANGENTIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "STEREO" in document and any(name.startswith("LEFT_CAM_") for name in document.content)


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all resolutions, left and right."""
    document = documents[0]
    stereo = _lower(document.table("STEREO"))
    cameras = []
    for resolution, size in _SIZES.items():
        if f"LEFT_CAM_{resolution}" not in document:
            continue
        turn = stereo.scalars((f"{axis}_{resolution.lower()}" for axis in ("rx", "cv", "rz")), 0.0)
        place = stereo.scalars(("baseline", "ty", "tz"), 0.0) * (-1, 1, 1)
        if not place[0]:
            raise InputError(document.file, "no Baseline in [STEREO]; expected it in mm")
        for side, pose in (("LEFT", np.eye(4)), ("RIGHT", transform(cv2.Rodrigues(turn)[0], place))):
            table = document.table(f"{side}_CAM_{resolution}")
            lens = _lower(document.table(f"{side}_DISTO") if f"{side}_DISTO" in document else table)
            is_fisheye = "k4" in lens and "p1" not in lens
            D = lens.scalars(_FISHEYE if is_fisheye else _RADIAL_TANGENTIAL, 0.0)
            K = camera_matrix(_lower(table).scalars(("fx", "fy", "cx", "cy")))
            name = f"{side}_CAM_{resolution}"
            model: Lens = "fisheye" if is_fisheye else "radtan"
            cameras.append(CalibratedCamera(document.file, name, K, D, model, size, pose, unit_m=0.001))
    return cameras


def _lower(table: Document) -> Document:
    """Its keys in lower case, as some write them."""
    return Document(table.file, {key.lower(): value for key, value in table.content.items()})
