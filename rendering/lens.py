"""What the graphics side is told of an eye's lens: vertices are drawn where the lens bends them to."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera
from pps_vision.types import Array


@dataclass(frozen=True)
class Lens:
    """A camera whose distortion can be undone all over its image; ValueError for another."""

    camera: Camera

    def __post_init__(self) -> None:
        if any(self.camera.distortion) and not self.camera.is_usable():
            raise ValueError(
                f"distortion {self.camera.distortion} leaves parts of {self.camera.width}×{self.camera.height} px "
                "undefined; expected a lens that can be undone over the whole image"
            )

    @cached_property
    def _slopes_of_pixels(self) -> Array:
        """(h, w, 2) x/z and y/z of every pixel's ray."""
        rays = self.camera.bearing_map
        return rays[..., :2] / rays[..., 2:]

    @cached_property
    def slopes(self) -> tuple[float, float, float, float]:
        """Least x/z and y/z, greatest x/z and y/z of anything in the image, a pixel's margin included."""
        c, xy = self.camera, self._slopes_of_pixels.reshape(-1, 2)
        (left, top), (right, bottom) = xy.min(axis=0), xy.max(axis=0)
        return left - 1 / c.fx, top - 1 / c.fy, right + 1 / c.fx, bottom + 1 / c.fy

    @cached_property
    def _r2_max(self) -> float:
        """Largest x² + y² of any pixel's ray at z = 1."""
        return float((self._slopes_of_pixels**2).sum(axis=-1).max())

    def uniform(self, offset_px: Array) -> NDArray[np.float32]:
        """(10,) what the vertex shader calls `lens`; pixels are sampled `offset_px` from their centres."""
        c = self.camera
        k1, k2, p1, p2, k3 = c.distortion
        size = np.array([c.width, c.height])
        f = 2 * np.array([c.fx, c.fy]) / size
        # OpenGL counts from the image's corner, we from the first pixel's centre: half a pixel between
        center = 2 * (np.array([c.cx, c.cy]) + 0.5 - offset_px) / size - 1
        return np.array([*f, *center, k1, k2, p1, p2, k3, self._r2_max], np.float32)
