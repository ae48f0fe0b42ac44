"""Readers and writers of recordings, calibrations and results.

This module holds the names that a user chooses from; importing them loads no other module.
"""

from dataclasses import dataclass
from typing import Literal

SUMMARY = "summary.json"
BATCH = "batch.csv"
REPORT = "report.html"
"""Files of a tracked recording or of a batch, whose table is `BATCH`."""
KEY_FRAMES = "keyframes"
"""Folder of a report's pictures."""
MAX_SKEW_S = 0.02
"""Left and right images further apart in time are no pair, unless the user says otherwise."""
Form = Literal["tum", "anipose", "mot", "coco", "ros2"]
"""Forms of other tools in which tracks and detections are written; `pps_vision.recordings.exchange` says what is in
them."""
Clock = Literal["stamps", "auto"]
"""Stamps of the right camera as they are, or corrected by the delay that points show."""
TimeUnit = Literal["s", "ms", "us", "ns"]
"""Units of stamps."""
Layout = Literal["lr", "rl", "tb", "bt"]
"""Where an image shows the views of the left and the right camera: left to right, or top to bottom."""
Lens = Literal["radtan", "fisheye"]
"""Models of a lens: radial and tangential distortion (OpenCV's 4 to 14 coefficients), or OpenCV's fisheye (4)."""


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Facts that a calibration leaves out."""

    unit_m: float = 1.0
    """Metres per length unit of the calibration (0.01 if its board was measured in cm); 1: as its form states, else
    m."""
    cameras: tuple[str, str] | None = None
    """Left and right camera by their names in the calibration, where it has more than two."""
    lens: Lens | None = None
    """The lens model, where the calibration does not state it: radtan (cv2.calibrateCamera) or fisheye (cv2.fisheye).
    """
    crop: tuple[int, int] | None = None
    """X Y: the images are cut out of those of the calibration; the pixel there that is their top-left one."""
    scaled: bool = False
    """The images are those of the calibration at another resolution."""
    rectified: bool = False
    """The images are rectified: use the calibration's projections P1 and P2."""
