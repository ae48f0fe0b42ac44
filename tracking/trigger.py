"""What moves by itself: the part of an image that the head's own motion does not explain.

R uses the residual of pyramidal Lucas–Kanade flow on a grid (FACTS §4).  Here the eye's motion is
known from the joints, so an older image is warped to the present pose, and a pixel is on where it is
brighter or darker than anything the older image had within the tolerated parallax: about 6 times
cheaper than the grid, and it sees objects of 4 px.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image, Mask
from tracking.ego_motion import EgoMotion


@dataclass(frozen=True)
class TriggerParams:
    """`interval_s` between the images compared, long enough for a slow object to move; `tolerance_px`
    of pose error and `max_parallax_px`, beyond which a fast head makes us wait; `noise_factor` times
    the image noise, or at least `min_contrast` grey levels, switch a pixel on; `min_area_px` of such
    pixels make a region; `join_px` is how far apart parts of one object may be; `central` the share
    of the image's sides looked at."""

    interval_s: float = 0.2
    tolerance_px: float = 1.0
    max_parallax_px: float = 4.0
    noise_factor: float = 5.0
    min_contrast: float = 8.0
    min_area_px: int = 16
    join_px: int = 4
    central: float = 0.92
    scene_depth_m: float = 1.0
    near_m: float = 0.5

    def __post_init__(self) -> None:
        if not (self.interval_s > 0 and self.tolerance_px >= 0 and self.min_area_px >= 1 and 0 < self.central <= 1):
            raise ValueError(f"{self}: expected a positive interval and area, and a central share in (0, 1]")


@dataclass(frozen=True, slots=True)
class Region2D:
    """A moving patch: box (x, y, width, height px), which pixels of it are on (height, width), and
    their summed contrast."""

    box_px: tuple[int, int, int, int]
    mask: Mask
    evidence: float


@dataclass(frozen=True, slots=True)
class _Past:
    image: Image
    grey: NDArray[np.uint8]
    view: View
    stamp_s: float
    own: Mask | None


class Trigger:
    """Finds moving regions in one eye's images; remembers the last fraction of a second."""

    def __init__(self, params: TriggerParams, camera: Camera) -> None:
        self.params = params
        self.ego = EgoMotion(camera, params.scene_depth_m, params.near_m)
        self._past: deque[_Past] = deque()

    def step(self, image: Image, view: View, stamp_s: float, own: Mask | None = None) -> list[Region2D]:
        """Moving regions, strongest first; `own` (H, W) marks the robot's own body, which is no stimulus."""
        grey = cv2.blur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (3, 3))
        present = _Past(image.copy(), np.asarray(grey, dtype=np.uint8), view, stamp_s, own)
        interval_s = self.params.interval_s
        while self._past and stamp_s - self._past[0].stamp_s > 3 * interval_s:
            self._past.popleft()  # from before something was tracked
        while len(self._past) > 1 and stamp_s - self._past[1].stamp_s >= interval_s - 1e-6:
            self._past.popleft()
        regions = self._regions(self._past[0], present) if self._past else []
        self._past.append(present)
        return regions

    def _regions(self, then: _Past, now: _Past) -> list[Region2D]:
        p, still = self.params, self.ego.is_still(then.view, now.view)
        parallax = 0.0 if still else self.ego.parallax_px(then.view, now.view)
        if parallax > p.max_parallax_px:
            return []
        tolerance_px = p.tolerance_px + parallax
        surprise = self._surprise(then.grey, now.grey, then, now, tolerance_px)
        if np.count_nonzero(surprise) < p.min_area_px:
            return []
        colors = [np.asarray(cv2.blur(one.image, (3, 3)), dtype=np.uint8) for one in (then, now)]
        surprise = self._surprise(colors[0], colors[1], then, now, tolerance_px)  # with all its colours
        on = (surprise > 0).view(np.uint8)
        side = 2 * p.join_px + 1
        joined = cv2.morphologyEx(on, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(joined)
        regions = [self._region(k, stats[k], np.asarray(labels), surprise) for k in range(1, count)]
        regions = [r for r in regions if np.count_nonzero(r.mask) >= p.min_area_px]
        return sorted(regions, key=lambda r: -r.evidence)

    @staticmethod
    def _region(
        label: int, stats: NDArray[np.integer], labels: NDArray[np.integer], surprise: NDArray[np.uint8]
    ) -> Region2D:
        x, y, w, h = (int(side) for side in stats[:4])
        crop = np.s_[y : y + h, x : x + w]
        contrast = np.where(labels[crop] == label, surprise[crop], 0)
        return Region2D((x, y, w, h), contrast > 0, float(contrast.sum()))

    def _surprise(
        self, old: NDArray[np.uint8], new: NDArray[np.uint8], then: _Past, now: _Past, tolerance_px: float
    ) -> NDArray[np.uint8]:
        """(H, W) by how many levels each pixel exceeds what the older image explains, noise included;
        of colour images (H, W, 3) the most of the three channels."""
        still = self.ego.is_still(then.view, now.view)
        if not still:
            old = self.ego.warp(old, then.view, now.view)
        difference = new[::4, ::4].astype(np.int16) - old[::4, ::4]
        exposure = float(np.median(difference))
        noise = 1.4826 * float(np.median(np.abs(difference - exposure)))
        threshold = max(self.params.noise_factor * noise, self.params.min_contrast)
        kernel = np.ones((2 * round(tolerance_px) + 1,) * 2, np.uint8)
        high, low = cv2.dilate(old, kernel), cv2.erode(old, kernel)
        if not still:  # what the older image did not see explains everything
            low[old == 0], high[old == 0] = 0, 255
        brighter = cv2.subtract(new, cv2.add(high, np.full(4, threshold + exposure)))
        darker = cv2.subtract(cv2.add(low, np.full(4, exposure - threshold)), new)
        surprise = np.asarray(cv2.max(brighter, darker), dtype=np.uint8)
        if surprise.ndim == 3:
            surprise = surprise.max(axis=2)
        height, width = surprise.shape
        mx, my = round((1 - self.params.central) / 2 * width), round((1 - self.params.central) / 2 * height)
        surprise[:my], surprise[height - my :] = 0, 0
        surprise[:, :mx], surprise[:, width - mx :] = 0, 0
        self._ignore_own(surprise, then, now, still)
        return surprise

    def _ignore_own(self, surprise: NDArray[np.uint8], then: _Past, now: _Past, still: bool) -> None:
        """Clear what is, or was, the robot's own body."""
        if now.own is not None:
            surprise[now.own] = 0
        if then.own is not None and then.own.any():
            was = then.own.view(np.uint8)
            surprise[(was if still else self.ego.warp(was, then.view, now.view)) != 0] = 0
