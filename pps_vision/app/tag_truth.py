"""The true path of a stimulus from an ArUco tag that is rigid to it: `pps-vision truth`."""

import cv2
import numpy as np

from pps_vision.app.evaluate import rigid_alignment
from pps_vision.errors import InputError
from pps_vision.geometry.triangulation import triangulate
from pps_vision.recordings.recording import Recording
from pps_vision.types import Array, Image

_CORNER_PX2 = 0.1**2  # variance of a refined corner; both eyes are taken to be equally sharp


def tag_path(
    recording: Recording, number: int, side_m: float, offset_m: Array, dictionary: str
) -> tuple[Array, Array, Array]:
    """Triangulate the corners of a tag in every pair that shows it in both images; InputError if there is none.

    Returns stamps (n,), positions (n, 3) m of a point, root frame, and measured sides of the tag (n,) m.

    `side_m`: of its black square; `offset_m` (3,): from the tag's centre to the point, in the tag's frame: x to its
    right, y to its top, z out of it; `dictionary`: its name in OpenCV, without DICT_.
    """
    rig = recording.calibrated()
    if not hasattr(cv2.aruco, f"DICT_{dictionary}"):
        raise InputError("truth", f"dictionary {dictionary!r}; expected one of OpenCV's, such as 4X4_50")
    if not 0 < side_m < np.inf:
        raise InputError("truth", f"a tag of {1000 * side_m:g} mm; expected a positive length")
    params = cv2.aruco.DetectorParameters()
    params.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    tags = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    detector = cv2.aruco.ArucoDetector(tags, params)
    cov = _CORNER_PX2 * np.eye(2)
    square = side_m / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    rows = []
    for frame in recording:
        left_px, right_px = (_corners(detector, image, number) for image in (frame.left, frame.right))
        if left_px is None or right_px is None:
            continue
        corners = [triangulate(rig.view_of(frame), *both, cov, cov) for both in zip(left_px, right_px, strict=True)]
        points = np.array([corner.p_root for corner in corners if corner is not None])
        if len(points) < len(corners):
            continue
        R, t = rigid_alignment(square, points)
        mean_side_m = np.mean(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1))
        rows.append([frame.stamp_s, *(R @ offset_m + t), mean_side_m])
    if not rows:
        raise InputError(recording.name, f"no pair shows tag {number} of {dictionary} in both images")
    table = np.array(rows)
    return table[:, 0], table[:, 1:4], table[:, 4]


def _corners(detector: cv2.aruco.ArucoDetector, image: Image, number: int) -> Array | None:
    """(4, 2) px of the tag: its top left, top right, bottom right and bottom left; None unless it is seen once."""
    quads, numbers, _ = detector.detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    matches = np.flatnonzero(np.ravel(numbers) == number) if numbers is not None else ()
    return np.asarray(quads[matches[0]], dtype=float).reshape(4, 2) if len(matches) == 1 else None
