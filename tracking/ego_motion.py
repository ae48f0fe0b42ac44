"""Seeing an older image through the eye where it is now: the head's own motion, known from the joints."""

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Array

_STEP = 8  # px between the nodes at which the warp is computed; between them it is smooth


class EgoMotion:
    """Warps grey images of one camera between its poses.

    The scene is taken to be `scene_depth_m` away: right for rotations, and for translations as far
    as the scene is that deep; `parallax_px` says how wrong it is for things nearer or farther.
    """

    def __init__(self, camera: Camera, scene_depth_m: float, near_m: float) -> None:
        self.camera, self.scene_depth_m, self.near_m = camera, scene_depth_m, near_m

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

    def parallax_px(self, then: View, now: View) -> float:
        """The most by which a static thing beyond `near_m` can be off after the warp."""
        shift = float(np.linalg.norm(now.center - then.center))
        return self.camera.focal_px * shift * max(1 / self.near_m - 1 / self.scene_depth_m, 1 / self.scene_depth_m)

    def warp(self, image: NDArray[np.uint8], then: View, now: View) -> NDArray[np.uint8]:
        """`image` (H, W) or (H, W, 3), taken from `then`, as it would look from `now`; 0 where it does not reach."""
        T_then_now = then.T_camera_root @ now.T_root_camera
        points = self._nodes @ T_then_now[:3, :3].T * self.scene_depth_m + T_then_now[:3, 3]
        nodes = np.nan_to_num(self.camera.project(points), nan=-1e4).astype(np.float32)
        rows, columns = nodes.shape[:2]
        whole = cv2.resize(nodes, (columns * _STEP, rows * _STEP), interpolation=cv2.INTER_LINEAR)
        maps = whole[_STEP : _STEP + self.camera.height, _STEP : _STEP + self.camera.width]
        map_x, map_y = cv2.split(maps)
        return np.asarray(cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8)
