"""The robot's own bodies as masks in its camera images."""

import cv2
import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.model import Body, Robot
from pps_vision.types import Array, Mask

_MAX_PX = 1e4  # clips the unbounded projections of points beside the eye
_ROUND = 12  # points around a circle; its polygon is widened to enclose it


class Silhouette:
    """Projects the convex hull of each of a robot's bodies; `margin_px` allows for calibration errors."""

    def __init__(self, robot: Robot, margin_px: int = 4) -> None:
        if margin_px < 0:
            raise ValueError(f"silhouette margin {margin_px} px; expected 0 or more")
        self.robot = robot
        self.margin_px = margin_px
        # (frame, points (n, 3) in that frame) of every body
        self._bodies = [(body.frame, move_points(body.T_frame_body, _hull_points(body))) for body in robot.bodies]

    def __call__(self, joints_rad: Array, view: View) -> Mask:
        """(H, W) mask of the robot at `joints_rad` in `view`, widened by the margin."""
        posture = self.robot.at(joints_rad)
        mask = np.zeros((view.camera.height, view.camera.width), np.uint8)
        points = np.concatenate([posture.point(frame, shape) for frame, shape in self._bodies])
        pixels = view.project(points)
        ends = np.cumsum([len(shape) for _, shape in self._bodies])
        for outline in np.split(pixels, ends[:-1]):
            visible = np.clip(outline[np.isfinite(outline).all(axis=1)], -_MAX_PX, _MAX_PX)
            if len(visible) and np.all(visible.max(axis=0) >= 0) and np.all(visible.min(axis=0) < mask.shape[::-1]):
                cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(visible).astype(np.int32)), (1,))
        if mask.any():
            mask = np.asarray(cv2.dilate(mask, np.ones((2 * self.margin_px + 1,) * 2, np.uint8)), dtype=np.uint8)
        return mask.view(bool)


def _hull_points(body: Body) -> Array:
    """(n, 3) points whose convex hull encloses the body, or nearly, in the body's own frame."""
    angle = np.arange(_ROUND) * 2 * np.pi / _ROUND
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) / np.cos(np.pi / _ROUND)
    if body.shape == "box":
        corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
        return corners * np.array(body.size_m)
    if body.shape == "cylinder":
        radius, length = body.size_m
        return np.vstack([np.column_stack([radius * circle, np.full(_ROUND, z)]) for z in (-length / 2, length / 2)])
    latitudes = np.deg2rad([-60.0, -20.0, 20.0, 60.0])
    rings = [np.column_stack([np.cos(a) * circle, np.full(_ROUND, np.sin(a))]) for a in latitudes]
    return body.size_m[0] * 1.04 * np.vstack([*rings, [[0, 0, 1], [0, 0, -1]]])
