"""Camera calibrations in the robot's own form, icubEyes.ini, and cameras for images of another size."""

from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.recordings.text import finite
from pps_vision.recordings.yarp_text import Section, read_sections

LARGEST_SIDE_PX = 2**16
"""Largest width and height of an image that a calibration may be for."""
_KEYS = ("w", "h", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
_SECTIONS = {"left": "CAMERA_CALIBRATION_LEFT", "right": "CAMERA_CALIBRATION_RIGHT"}


def read_icub_eyes(file: Path, image_size: tuple[int, int] | None = None) -> tuple[Camera, Camera]:
    """Return the left and the right camera; for images of `image_size` (width, height) if given.  InputError where the
    file, a section, a key or a number is missing, or the images have other proportions."""
    sections = read_sections(file, "a calibration of both eyes")
    if missing := [name for name in _SECTIONS.values() if name not in sections]:
        raise InputError(file, f"no section [{missing[0]}]; expected one for each eye")
    left, right = (fit_to_images(_camera(sections[name]), image_size, file) for name in _SECTIONS.values())
    return left, right


def _camera(section: Section) -> Camera:
    """Return the camera that one section describes."""
    entries = section.required(_KEYS)
    width, height, fx, fy, *others = (entry.number(finite) for entry in entries)
    for entry, value in zip(entries[:4], (width, height, fx, fy), strict=True):
        if not value > 0:
            raise entry.error("a positive number")
    for entry, value in zip(entries[:2], (width, height), strict=True):
        if not value.is_integer() or value > LARGEST_SIDE_PX:
            raise entry.error(f"a whole number of pixels, at most {LARGEST_SIDE_PX}")
    cx, cy, k1, k2, p1, p2 = others
    return Camera(int(width), int(height), fx, fy, cx, cy, (k1, k2, p1, p2, 0.0))


def write_icub_eyes(file: Path, left: Camera, right: Camera) -> None:
    """Write an icubEyes.ini; ValueError for another lens, which the form has no place for."""
    sections = []
    for side, camera in (("left", left), ("right", right)):
        if camera.fisheye or any(camera.distortion[4:]):
            raise ValueError(
                f"{side} camera has a k3 or is a fisheye; expected k1, k2, p1, p2 as icubEyes.ini holds them"
            )
        coefficients = camera.distortion[:4]
        values = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, *coefficients)
        rows = [f"{key} {value!r}" for key, value in zip(_KEYS, values, strict=True)]
        sections.append("\n".join([f"[{_SECTIONS[side]}]", "projection pinhole", *rows, ""]))
    file.write_text("\n".join(sections))


def fit_to_images(camera: Camera, image_size: tuple[int, int] | None, file: Path) -> Camera:
    """The camera for images of another resolution (width, height).

    InputError if their proportions differ, or the camera has no bearing for every pixel.
    """
    if not camera.is_usable():
        numbers = f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g}"
        reason = f"{camera.width}×{camera.height} pixels, {numbers}, distortion {camera.distortion}"
        raise InputError(file, f"{reason}; expected a camera whose pixels can be traced back to distinct directions")
    if image_size is None or image_size == (camera.width, camera.height):
        return camera
    width, height = image_size
    if abs(width / camera.width * camera.height - height) > 1:  # a pixel of rounding
        reason = f"calibrated for {camera.width}×{camera.height} pixels, images are {width}×{height}"
        raise InputError(file, f"{reason}; expected the same proportions")
    return camera.stretched(width, height)
