"""ROS camera_info: one camera a file or message; the baseline is in the right one's projection; in m.

p_rectified = R p_camera, and P = [K' | K' t] of the rectified camera, which is t beside the left one.  A region of
interest and binning, as the message states them, are applied: images of another size than the sensor's are then what
the calibration is for.
"""

from collections.abc import Sequence

import numpy as np

from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.calibrations import CalibratedCamera, lens_of, rectified_camera, size_of
from pps_vision.recordings.documents import Document
from pps_vision.types import Array

FORM = "ROS camera_info"
_KEYS = {  # of camera_calibration's files; the messages of ROS 1 and 2 have the others
    "camera_matrix": ("K", "k"),
    "distortion_coefficients": ("D", "d"),
    "rectification_matrix": ("R", "r"),
    "projection_matrix": ("P", "p"),
    "image_width": ("width",),
    "image_height": ("height",),
}


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return "projection_matrix" in document or ("distortion_model" in document and ("P" in document or "p" in document))


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """The cameras of all files."""
    return [camera_of(document) for document in documents]


def camera_of(document: Document) -> CalibratedCamera:
    """The camera of a camera_info; InputError if it cannot be used."""
    content = dict(document.content)
    for key, others in _KEYS.items():
        for other in others:
            if other in content:
                content[key] = content[other]
    document = Document(document.file, content)
    lens = lens_of(document, "distortion_model")
    P = document.numbers("projection_matrix", 3, 4)
    R = transform(document.numbers("rectification_matrix", 3, 3))
    K = document.numbers("camera_matrix", 3, 3)
    size = size_of(document, "image_width", "image_height")
    binned, size = _window(document, size)
    name = document.word("camera_name")
    rectified = rectified_camera(document.file, name, binned @ P, size)
    D = document.numbers("distortion_coefficients")
    pose = inverse(R) @ rectified.pose
    return CalibratedCamera(document.file, name, binned @ K, D, lens, size, pose, rectified=rectified)


def _window(document: Document, size: tuple[float, float] | None) -> tuple[Array, tuple[float, float] | None]:
    """(3, 3) pixels of the sensor to pixels of the images, by the region of interest and binning; the images' size."""
    roi = document.table("roi") if "roi" in document else Document(document.file, {})
    window = np.eye(3)
    sides = []
    for axis, (offset, side) in enumerate((("x_offset", "width"), ("y_offset", "height"))):
        binning = max(document.scalars([f"binning_{'xy'[axis]}"], 0.0)[0], 1.0)
        first, length = roi.scalars((offset, side), 0.0)
        window[axis, axis] = 1 / binning
        window[axis, 2] = (0.5 - first) / binning - 0.5  # integer coordinates are pixel centres
        sides.append((length or (size[axis] if size else 0)) // binning)
    return window, (sides[0], sides[1]) if size else None
