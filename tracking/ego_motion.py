"""Warp an earlier image to the camera's current pose (ego-motion known from the joints)."""

from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Array

Box = tuple[int, int, int, int]  # x0, y0, x1, y1: pixels x0 … x1 − 1
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
ROOM_M = 1.2
"""Assumed distance of the static scene."""
_NO_MAP = np.empty(0, np.float32)  # remap's second map, when the first holds both coordinates
_STEP = 8  # px between the nodes at which the warp is computed; between them it is smooth
_FAR_PX = np.float32(-1e4)  # pixel of a direction that the image does not contain
_STILL = 1e-5  # rad and m: far less than a hundredth of a pixel


class EgoMotion:
    """Warps images of one camera between its poses.

    The effect of a translation depends on the scene's distance, which is unknown: the caller gives the inverse distance
    (1/m; 0 is infinity) of the points that shall coincide.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    @cached_property
    def _nodes(self) -> Array:
        """(rows, columns, 3) directions of a grid of pixels that reaches one cell beyond the image."""
        columns = -(-self.camera.width // _STEP) + 2
        rows = -(-self.camera.height // _STEP) + 2
        v, u = np.mgrid[:rows, :columns] * _STEP - _STEP + (_STEP - 1) / 2
        return self.camera.bearings(np.stack([u, v], axis=-1))

    @staticmethod
    def is_still(earlier: View, current: View) -> bool:
        """Whether both poses are equal."""
        return earlier is current or bool((np.abs(earlier.T_root_camera - current.T_root_camera) < _STILL).all())

    def parallax_px_m(self, earlier: View, current: View) -> float:
        """Parallax in the earlier image (px) per 1/m of inverse distance."""
        return self.camera.focal_px * float(np.linalg.norm(current.center - earlier.center))

    def project(self, directions: Array, earlier: View, current: View, inverse_distance: float) -> Array:
        """Pixels (…, 2) in the earlier view of directions (…, 3) of the current one; NaN where it does not
        contain them."""
        T_earlier_current = earlier.T_camera_root @ current.T_root_camera
        points = directions @ T_earlier_current[:3, :3].T + inverse_distance * T_earlier_current[:3, 3]
        return self.camera.project(points)

    def maps(
        self, earlier: View, current: View, inverse_distance: float, box: Box | None = None
    ) -> NDArray[np.float32]:
        """Pixels (y1 − y0, x1 − x0, 2) in the earlier view of the pixels of `box` (None: of all) in the current one;
        far outside the image where the earlier view does not contain them."""
        x0, y0, x1, y1 = box or (0, 0, self.camera.width, self.camera.height)
        first_row = y0 // _STEP
        first_column = x0 // _STEP
        cells = np.s_[first_row : -(-y1 // _STEP) + 2, first_column : -(-x1 // _STEP) + 2]
        nodes = self.project(self._nodes[cells], earlier, current, inverse_distance).astype(np.float32)
        nodes[np.isnan(nodes)] = _FAR_PX
        rows, columns = nodes.shape[:2]
        whole = cv2.resize(nodes, (columns * _STEP, rows * _STEP), interpolation=cv2.INTER_LINEAR)
        top = y0 - _STEP * first_row + _STEP
        left = x0 - _STEP * first_column + _STEP
        return np.asarray(whole[top : top + y1 - y0, left : left + x1 - x0], dtype=np.float32)

    def warp(
        self, image: NDArray[np.uint8], earlier: View, current: View, inverse_distance: float, box: Box | None = None
    ) -> NDArray[np.uint8]:
        """The earlier image (H, W) or (H, W, 3) warped to the current view, or its `box`; 0 where unknown."""
        maps = self.maps(earlier, current, inverse_distance, box)
        return np.asarray(cv2.remap(image, maps, _NO_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8)


def channel_maximum(levels: NDArray[Any]) -> NDArray[np.uint8]:
    """Largest of the three channels (h, w)."""
    red, green, blue = cv2.split(levels)
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)


def color_difference(colors: NDArray[np.float32], points: Array, image: NDArray[np.uint8], view: View) -> float:
    """Mean absolute difference (grey levels) between the colours (n, 3) of points (n, 3; root frame) and their colours
    in an image (H, W, 3) of `view` (0 outside of it)."""
    pixels = view.project(points).astype(np.float32)
    sampled = cv2.remap(image, pixels[None], _NO_MAP, cv2.INTER_LINEAR)[0]
    return float(np.abs(sampled - colors).mean())
