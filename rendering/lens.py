"""Lens distortion by remapping: a pinhole camera that covers a lens's view, and the map between their images."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera
from pps_vision.types import Array


@dataclass(frozen=True)
class Lens:
    """A camera whose distortion is invertible over its whole image; ValueError for another."""

    camera: Camera

    def __post_init__(self) -> None:
        if any(self.camera.distortion) and not self.camera.is_usable():
            raise ValueError(
                f"distortion {self.camera.distortion} leaves parts of {self.camera.width}×{self.camera.height} px "
                "undefined; expected a lens that can be undone over the whole image"
            )

    @cached_property
    def _slopes_of_pixels(self) -> Array:
        """x/z and y/z of every pixel's ray, (h, w, 2)."""
        rays = self.camera.bearing_map()
        return rays[..., :2] / rays[..., 2:]

    @cached_property
    def slopes(self) -> tuple[float, float, float, float]:
        """Smallest x/z and y/z, largest x/z and y/z in the image, with a margin of one pixel."""
        c = self.camera
        xy = self._slopes_of_pixels.reshape(-1, 2)
        (left, top) = xy.min(axis=0)
        (right, bottom) = xy.max(axis=0)
        return left - 1 / c.fx, top - 1 / c.fy, right + 1 / c.fx, bottom + 1 / c.fy

    def map_to(self, pinhole: Camera) -> tuple[Array, Array]:
        """Return the maps for `cv2.remap` from the image of a pinhole camera at the same place."""
        x, y = np.moveaxis(self._slopes_of_pixels, -1, 0)
        u = pinhole.fx * x + pinhole.cx
        v = pinhole.fy * y + pinhole.cy
        maps = cv2.convertMaps(u.astype(np.float32), v.astype(np.float32), cv2.CV_16SC2)
        return np.asarray(maps[0]), np.asarray(maps[1])


def pinholes(lenses: Sequence[Lens], scale: float) -> list[Camera]:
    """Return pinhole cameras that cover the lenses' views, with `scale` times their focal lengths and one image size.

    At scale 1 and without distortion their pixels coincide with the lens's.
    """
    cameras = [lens.camera for lens in lenses]
    focal = scale * np.array([[c.fx, c.fy] for c in cameras])
    center = scale * (np.array([[c.cx, c.cy] for c in cameras]) + 0.5) - 0.5  # pixel centres are integers
    lowest, highest = np.array([lens.slopes for lens in lenses]).reshape(-1, 2, 2).swapaxes(0, 1)  # x/z and y/z
    first = np.floor(lowest * focal + center)
    size = (np.ceil(highest * focal + center) - first + 1).max(axis=0).astype(int)
    return [Camera(*size.tolist(), *f, *c) for f, c in zip(focal.tolist(), (center - first).tolist(), strict=True)]
