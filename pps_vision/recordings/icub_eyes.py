"""Camera calibrations in the robot's own form (icubEyes.ini), and fitting one to the images' size."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pps_vision.errors import InputError, first_line
from pps_vision.geometry.camera import Camera

_KEYS = ("w", "h", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
_SECTIONS = {"left": "CAMERA_CALIBRATION_LEFT", "right": "CAMERA_CALIBRATION_RIGHT"}

Entry = tuple[str, int]  # the text after a key, and its line


def read_icub_eyes(file: Path, image_size: tuple[int, int] | None = None) -> tuple[Camera, Camera]:
    """Left and right camera from an icubEyes.ini; for images of `image_size` (width, height) if given.

    InputError if the file, a section, a key or a number is missing, or the images have other proportions.
    """
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected a calibration of both eyes") from error
    sections: dict[str, tuple[int, dict[str, Entry]]] = {}
    entries: dict[str, Entry] = {}
    for number, text in enumerate(lines, start=1):
        words = text.split()
        if words and words[0].startswith("["):
            entries = {}
            sections[" ".join(words).strip("[]")] = (number, entries)
        elif len(words) >= 2:
            entries[words[0]] = (words[1], number)
    left, right = (_icub_camera(file, name, sections) for name in _SECTIONS.values())
    return fit_to_images(left, image_size, file), fit_to_images(right, image_size, file)


def _icub_camera(file: Path, section: str, sections: Mapping[str, tuple[int, dict[str, Entry]]]) -> Camera:
    """The camera one section describes."""
    if section not in sections:
        raise InputError(file, f"no section [{section}]; expected one for each eye")
    start, entries = sections[section]
    values = {}
    for key in _KEYS:
        if key not in entries:
            raise InputError(file, f"[{section}] has no {key}; expected {', '.join(_KEYS)}", start)
        text, line = entries[key]
        try:
            values[key] = float(text)
        except ValueError as error:
            raise InputError(file, f"{key} {text}; expected a number", line) from error
        if not abs(values[key]) < float("inf"):
            raise InputError(file, f"{key} {text}; expected a finite number", line)
        if key in ("fx", "fy") and not values[key] > 0:
            raise InputError(file, f"{key} {text}; expected a positive number", line)
        if key in ("w", "h") and not (values[key] >= 1 and values[key].is_integer()):
            raise InputError(file, f"{key} {text}; expected a whole number of pixels", line)
    w, h, fx, fy, cx, cy, k1, k2, p1, p2 = (values[key] for key in _KEYS)
    return Camera(int(w), int(h), fx, fy, cx, cy, (k1, k2, p1, p2, 0.0))


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


def fit_to_images(camera: Camera, image_size: tuple[int, int] | None, file: Path) -> Camera:
    """The camera for images of another resolution (width, height).

    InputError if their proportions differ, or the camera has no bearing for every pixel.
    """
    if not camera.is_usable():
        numbers = f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g}"
        found = f"{camera.width}×{camera.height} pixels, {numbers}, distortion {camera.distortion}"
        raise InputError(file, f"{found}; expected a camera whose pixels can be traced back to distinct directions")
    if image_size is None or image_size == (camera.width, camera.height):
        return camera
    width, height = image_size
    sx, sy = width / camera.width, height / camera.height
    if abs(sx * camera.height - height) > 1:  # a pixel of rounding
        found = f"calibrated for {camera.width}×{camera.height} pixels, images are {width}×{height}"
        raise InputError(file, f"{found}; expected the same proportions")
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * sx,
        fy=camera.fy * sy,
        cx=(camera.cx + 0.5) * sx - 0.5,  # integer coordinates are pixel centres
        cy=(camera.cy + 0.5) * sy - 0.5,
    )
