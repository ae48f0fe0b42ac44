"""Camera calibrations in the robot's own form, icubEyes.ini."""

from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.recordings.calibration import LARGEST_SIDE_PX, fit_to_images
from pps_vision.recordings.yarp_text import Section, read_sections

_KEYS = ("w", "h", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
_SECTIONS = {"left": "CAMERA_CALIBRATION_LEFT", "right": "CAMERA_CALIBRATION_RIGHT"}


def read_icub_eyes(file: Path, image_size: tuple[int, int] | None = None) -> tuple[Camera, Camera]:
    """Return the left and the right camera; for images of `image_size` (width, height) if given.

    Raises:
        InputError: The file, a section, a key or a number is missing, or the images have other proportions.
    """
    sections = read_sections(file, "a calibration of both eyes")
    cameras = []
    for name in _SECTIONS.values():
        if name not in sections:
            raise InputError(file, f"no section [{name}]; expected one for each eye")
        cameras.append(_camera(sections[name]))
    left, right = cameras
    return fit_to_images(left, image_size, file), fit_to_images(right, image_size, file)


def _camera(section: Section) -> Camera:
    """Return the camera that one section describes."""
    entries = section.required(_KEYS)
    width, height, fx, fy, *others = (entry.number() for entry in entries)
    for entry, value in zip(entries[:4], (width, height, fx, fy), strict=True):
        if not value > 0:
            raise entry.error("a positive number")
    for entry, value in zip(entries[:2], (width, height), strict=True):
        if not value.is_integer() or value > LARGEST_SIDE_PX:
            raise entry.error(f"a whole number of pixels, at most {LARGEST_SIDE_PX}")
    cx, cy, k1, k2, p1, p2 = others
    return Camera(int(width), int(height), fx, fy, cx, cy, (k1, k2, p1, p2, 0.0))


def write_icub_eyes(file: Path, left: Camera, right: Camera) -> None:
    """Write an icubEyes.ini; ValueError for a k3, which the form has no place for."""
    sections = []
    for side, camera in (("left", left), ("right", right)):
        *coefficients, k3 = camera.distortion
        if k3 != 0:
            raise ValueError(f"{side} camera has k3 = {k3}; expected 0, icubEyes.ini holds k1, k2, p1, p2")
        values = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, *coefficients)
        rows = [f"{key} {value!r}" for key, value in zip(_KEYS, values, strict=True)]
        sections.append("\n".join([f"[{_SECTIONS[side]}]", "projection pinhole", *rows, ""]))
    file.write_text("\n".join(sections))
