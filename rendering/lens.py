"""From the pinhole image that OpenGL draws to the image behind the eye's distorting lens."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera

_MARGIN_PX = 2  # the interpolation's reach


@dataclass(frozen=True)
class Lens:
    """`pinhole` is the wider, undistorted camera to draw with; `warp` bends its image."""

    pinhole: Camera
    _maps: tuple[Any, Any] | None

    def warp(self, image: Any) -> Any:
        """What the camera records (within 1/32 px) of a drawn image, which may be larger than `pinhole`'s."""
        if self._maps is None:
            return image[: self.pinhole.height, : self.pinhole.width]
        return cv2.remap(image, *self._maps, cv2.INTER_LINEAR)


def make_lens(camera: Camera) -> Lens:
    """The lens of a camera; ValueError where its distortion cannot be undone over the image."""
    if not any(camera.distortion):
        return Lens(camera, None)
    if not camera.is_usable():
        raise ValueError(
            f"distortion {camera.distortion} leaves parts of {camera.width}×{camera.height} px undefined; "
            "expected a lens that can be undone over the whole image"
        )
    x, y = np.moveaxis(camera.bearing_map[..., :2] / camera.bearing_map[..., 2:], -1, 0)
    u, v = camera.fx * x + camera.cx, camera.fy * y + camera.cy
    left, top = np.floor([u.min(), v.min()]) - _MARGIN_PX
    right, bottom = np.ceil([u.max(), v.max()]) + _MARGIN_PX
    pinhole = replace(
        camera,
        width=int(right - left) + 1,
        height=int(bottom - top) + 1,
        cx=camera.cx - left,
        cy=camera.cy - top,
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
    )
    maps = cv2.convertMaps((u - left).astype(np.float32), (v - top).astype(np.float32), cv2.CV_16SC2)
    return Lens(pinhole, (maps[0], maps[1]))
