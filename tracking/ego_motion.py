"""Seeing an older image through the eye where it is now: the head's own motion, known from the joints."""

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Array

Box = tuple[int, int, int, int]  # x0, y0, x1, y1: pixels x0 … x1 − 1
_NO_MAP = np.empty(0, np.float32)  # remap's second map, when the first holds both coordinates
_STEP = 8  # px between the nodes at which the warp is computed; between them it is smooth


class EgoMotion:
    """Warps grey images of one camera between its poses.

    What a translation does depends on the distance, which nobody knows: the caller says which
    (as 1/m, so that 0 is infinitely far) it wants the scene warped for.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    @cached_property
    def _nodes(self) -> Array:
        """(rows, columns, 3) directions of a grid of pixels that reaches one cell beyond the image."""
        columns, rows = -(-self.camera.width // _STEP) + 2, -(-self.camera.height // _STEP) + 2
        v, u = np.mgrid[:rows, :columns] * _STEP - _STEP + (_STEP - 1) / 2
        return self.camera.bearings(np.stack([u, v], axis=-1))

    @staticmethod
    def is_still(then: View, now: View) -> bool:
        """Whether the eye has not moved at all."""
        return then is now or bool(np.allclose(then.T_root_camera, now.T_root_camera, atol=1e-7))

    def parallax_px_m(self, then: View, now: View) -> float:
        """How far apart, in the older image, things are whose inverse distances differ by 1/m."""
        return self.camera.focal_px * float(np.linalg.norm(now.center - then.center))

    def warp(
        self, image: NDArray[np.uint8], then: View, now: View, inverse_distance: float, box: Box | None = None
    ) -> NDArray[np.uint8]:
        """`image` (H, W) or (H, W, 3), taken from `then`, as it would look from `now`: all of it, or the
        pixels x0 … x1 − 1, y0 … y1 − 1 of `box`; 0 where it does not reach."""
        x0, y0, x1, y1 = box or (0, 0, self.camera.width, self.camera.height)
        first_row, first_column = y0 // _STEP, x0 // _STEP
        cells = np.s_[first_row : -(-y1 // _STEP) + 2, first_column : -(-x1 // _STEP) + 2]
        T_then_now = then.T_camera_root @ now.T_root_camera
        points = self._nodes[cells] @ T_then_now[:3, :3].T + inverse_distance * T_then_now[:3, 3]
        nodes = np.nan_to_num(self.camera.project(points), nan=-1e4).astype(np.float32)
        rows, columns = nodes.shape[:2]
        whole = cv2.resize(nodes, (columns * _STEP, rows * _STEP), interpolation=cv2.INTER_LINEAR)
        top, left = y0 - _STEP * first_row + _STEP, x0 - _STEP * first_column + _STEP
        maps = np.ascontiguousarray(whole[top : top + y1 - y0, left : left + x1 - x0])
        return np.asarray(cv2.remap(image, maps, _NO_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8)
