"""The scene without the object, for images that have no colour to tell it by."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.types import Image
from tracking.ego_motion import EgoMotion

_RISE_LEVELS = 1.5  # grey levels from 'certainly background' to even odds, and again to certain


class Background:
    """A running average of one eye's grey images, held where the object is.

    It begins anew when the eye moves: warped to another pose, every edge at an unknown distance
    would pass for an object, and a confident wrong track is worse than none.
    """

    def __init__(self, ego: EgoMotion, memory_s: float) -> None:
        self.ego, self.memory_s = ego, memory_s
        self._scene: NDArray[np.float32] | None = None
        self._view: View | None = None
        self._stamp_s = 0.0

    def evidence(self, image: Image, view: View) -> NDArray[np.float32]:
        """(H, W) probability that each pixel is not the background: ½ at the noise's edge."""
        if self._scene is None or self._view is None or not self.ego.is_still(self._view, view):
            return np.zeros(image.shape[:2], np.float32)
        grey = cv2.blur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (3, 3)).astype(np.float32)
        kernel = np.ones((3, 3), np.uint8)
        over = cv2.max(grey - cv2.dilate(self._scene, kernel), cv2.erode(self._scene, kernel) - grey)
        noise = 1.4826 * float(np.median(np.abs(grey[::4, ::4] - self._scene[::4, ::4])))
        odds: NDArray[np.float32] = np.clip(over / (2 * max(_RISE_LEVELS, 3 * noise)), 0.0, 1.0)
        return odds

    def learn(self, image: Image, view: View, stamp_s: float, boxes: list[tuple[float, float, float, float]]) -> None:
        """Take an image in, except around the `boxes` (x, y, width, height px) of what moves."""
        grey = cv2.blur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (3, 3)).astype(np.float32)
        if self._scene is None or self._view is None or not self.ego.is_still(self._view, view):
            self._scene, self._view, self._stamp_s = grey, view, stamp_s
        rate = 1 - float(np.exp(-max(stamp_s - self._stamp_s, 0.0) / self.memory_s))
        newer = self._scene + rate * (grey - self._scene)
        for x, y, w, h in boxes:
            keep = np.s_[
                max(int(y - 0.3 * h), 0) : int(y + 1.3 * h) + 1, max(int(x - 0.3 * w), 0) : int(x + 1.3 * w) + 1
            ]
            newer[keep] = self._scene[keep]
        self._scene, self._stamp_s = newer, stamp_s
