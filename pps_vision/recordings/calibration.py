"""A calibrated camera for the images of a recording."""

from dataclasses import replace
from pathlib import Path

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera

LARGEST_SIDE_PX = 2**16
"""Largest width and height of an image that a calibration may be for."""


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
    sx = width / camera.width
    sy = height / camera.height
    if abs(sx * camera.height - height) > 1:  # a pixel of rounding
        reason = f"calibrated for {camera.width}×{camera.height} pixels, images are {width}×{height}"
        raise InputError(file, f"{reason}; expected the same proportions")
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * sx,
        fy=camera.fy * sy,
        cx=(camera.cx + 0.5) * sx - 0.5,  # integer coordinates are pixel centres
        cy=(camera.cy + 0.5) * sy - 0.5,
    )
