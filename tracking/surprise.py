"""What of an image no older image explains, wherever the eye was then and however far away things are."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.types import Mask
from tracking import masks
from tracking.ego_motion import Box, EgoMotion

Pixels = NDArray[np.uint8]  # (h, w) or (h, w, 3)
Bodies = Callable[[], tuple[Mask | None, Mask | None]]  # where the robot was in the older image, and is in the present


@dataclass(frozen=True)
class Limits:
    """`tolerance_px` of pose error; the change that is no noise: `noise_factor` times what is usual, at least
    `min_contrast` grey levels; the fewest pixels that count; and between what distances static things may be."""

    tolerance_px: float
    noise_factor: float
    min_contrast: float
    min_area_px: int
    near_m: float
    room_m: float


class Comparison:
    """An older and the present image of one eye, both seen from the present pose."""

    def __init__(self, limits: Limits, ego: EgoMotion, then: View, now: View, bodies: Bodies) -> None:
        self.limits, self.ego, self.then, self.now, self.bodies = limits, ego, then, now, bodies
        self.still = ego.is_still(then, now)
        self._levels: tuple[float, float] | None = None

    def unexplained(self, old: Pixels, new: Pixels, box: Box) -> tuple[Box, Pixels] | None:
        """The part of `box` where no distance explains the present pixels, and by how many levels each
        exceeds what they could be; None as soon as (nearly) everything is explained."""
        least: Pixels | None = None
        for inverse_distance in self._inverse_distances():
            surprise = self._surprise(old, new, inverse_distance, box)
            least = surprise if least is None else np.minimum(least, surprise)
            if np.count_nonzero(least) < self.limits.min_area_px:
                return None
            box, least = _shrunk(box, least)
        if least is None or np.count_nonzero(self._elsewhere(least, box)) < self.limits.min_area_px:
            return None
        return _shrunk(box, least)

    def _inverse_distances(self) -> list[float]:
        """1/m: the room's first, then all from the nearest, where the robot's own arms are, to infinity, no
        further apart than the tolerance covers."""
        p = self.limits
        spread_px = 0.0 if self.still else self.ego.parallax_px_m(self.then, self.now) / p.near_m
        steps = int(np.ceil(spread_px / (2 * self.limits.tolerance_px)))
        return [1 / p.room_m, *(np.linspace(1 / p.near_m, 0, steps + 1) if steps else [])]

    def _surprise(self, old: Pixels, new: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """(h, w) by how many levels each pixel of the box is brighter or darker than the older image explains,
        0 where that may be noise; of colour images (H, W, 3) the most of the three channels."""
        now = _cut(new, box)
        then, low, high = self._range(old, inverse_distance, box)
        exposure, threshold = self._levels = self._levels or self._measure_levels(then, now)
        if exposure:
            now = np.clip(now - np.float32(exposure), 0, 255).astype(np.uint8)
        beyond = cv2.max(cv2.subtract(now, high), cv2.subtract(low, now))
        surprise = np.asarray(cv2.threshold(beyond, threshold, 0, cv2.THRESH_TOZERO)[1], dtype=np.uint8)
        return surprise if surprise.ndim == 2 else surprise.max(axis=2)

    def _range(self, old: Pixels, inverse_distance: float, box: Box) -> tuple[Pixels, Pixels, Pixels]:
        """What the older image has at each pixel of the box, and the darkest and the brightest within the tolerance;
        every level, where it does not reach."""
        m = int(np.ceil(self.limits.tolerance_px))
        x0, y0, x1, y1 = box
        left, top = min(m, x0), min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, old.shape[1]), min(y1 + m, old.shape[0])
        seen = self._then_seen(old, inverse_distance, wide)
        kernel = masks.square(m)
        low, high = (np.asarray(one, np.uint8) for one in (cv2.erode(seen, kernel), cv2.dilate(seen, kernel)))
        unseen = None if self.still else low == 0
        if self.limits.tolerance_px < m:  # a fraction of the way to the darkest or brightest neighbour
            share = self.limits.tolerance_px / m
            low, high = (np.asarray(cv2.addWeighted(seen, 1 - share, one, share, 0), np.uint8) for one in (low, high))
        if unseen is not None:
            low[unseen], high[unseen] = 0, 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        return seen[inside], low[inside], high[inside]

    def _then_seen(self, old: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """What the older image has in the box as it would be seen now; 0 where it does not reach."""
        return _cut(old, box) if self.still else self.ego.warp(old, self.then, self.now, inverse_distance, box)

    def _measure_levels(self, then: Pixels, now: Pixels) -> tuple[float, float]:
        """How much brighter the image has become as a whole, and the change that is no noise."""
        difference = now[::6, ::6].astype(np.int16) - then[::6, ::6]
        exposure = _median(difference)
        noise = 1.4826 * _median(np.abs(difference - exposure))
        return exposure, max(self.limits.noise_factor * noise, self.limits.min_contrast)

    def _elsewhere(self, surprise: Pixels, box: Box) -> Pixels:
        """The same with nothing surprising where the robot itself is, or was: asked last, for it costs most."""
        then, now = self.bodies()
        if now is not None:
            surprise[_cut(now, box)] = 0
        if then is not None and then.any():
            surprise[self._then_seen(then.view(np.uint8), 1 / self.limits.room_m, box).view(bool)] = 0
        return surprise


def _median(values: NDArray[Any]) -> float:
    """The upper one of an even number: NumPy's own takes several times as long for a few hundred."""
    return float(np.partition(values, values.size // 2, axis=None)[values.size // 2])


def _cut(image: NDArray[Any], box: Box) -> NDArray[Any]:
    return image[box[1] : box[3], box[0] : box[2]]


def _shrunk(box: Box, surprise: Pixels) -> tuple[Box, Pixels]:
    """Only the rectangle in which anything is on."""
    x, y, w, h = cv2.boundingRect(surprise)
    return (box[0] + x, box[1] + y, box[0] + x + w, box[1] + y + h), surprise[y : y + h, x : x + w]
