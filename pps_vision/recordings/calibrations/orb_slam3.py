"""ORB-SLAM3's settings: Camera1, Camera2 and Stereo.T_c1_c2, the pose of the second camera in the first one's frame;
or rectified cameras with Stereo.b; in m."""

from collections.abc import Sequence

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.calibrations import CalibratedCamera, camera_matrix, lens_of, size_of
from pps_vision.recordings.documents import Document

FORM = "ORB-SLAM3's settings"


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "Camera1.fx" in document


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """Both cameras."""
    document = documents[0]
    is_rectified = document.word("Camera.type") == "Rectified"
    lens = "radtan" if is_rectified else lens_of(document, "Camera.type", "PinHole")
    if is_rectified:
        pose = transform(None, -document.numbers("Stereo.b", 1)[0] * np.array([1.0, 0, 0]))
    elif "Stereo.T_c1_c2" in document:
        pose = inverse(document.numbers("Stereo.T_c1_c2", 4, 4))
    else:
        raise InputError(document.file, "no Stereo.T_c1_c2; expected settings of a stereo camera")
    names = ("k1", "k2", "k3", "k4") if lens == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    cameras: list[CalibratedCamera] = []
    for camera, T in (("Camera1", np.eye(4)), ("Camera1" if is_rectified else "Camera2", pose)):
        K = camera_matrix(document.scalars(f"{camera}.{key}" for key in ("fx", "fy", "cx", "cy")))
        D = document.scalars((f"{camera}.{name}" for name in names * (not is_rectified)), 0.0)
        size = size_of(document, "Camera.width", "Camera.height")
        cameras.append(CalibratedCamera(document.file, f"Camera{len(cameras) + 1}", K, D, lens, size, T))
    return cameras
