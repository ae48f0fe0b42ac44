"""What moves by itself: the part of an image that the head's own motion does not explain.

R uses the residual of pyramidal Lucas–Kanade flow on a grid (FACTS §4).  Here the eye's motion is
known from the joints, so an older image is warped to the present pose, and a pixel is on where it is
brighter or darker than anything the older image had within the tolerated pose error, at whatever
distance things may be: several times cheaper than the grid, and it sees objects of 4 px.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image, Mask
from tracking.ego_motion import Box, EgoMotion


@dataclass(frozen=True)
class TriggerParams:
    """`interval_s` and `slow_interval_s`: how old an image is compared, in turns, the latter for slow
    or looming objects; younger ones while the head moves so fast that static things, which may be as
    near as `near_m` before a room about `room_m` away, uncover more than `max_parallax_px` of it.
    `tolerance_px` of pose error; `noise_factor` times the image noise, or at least `min_contrast` grey
    levels, switch a pixel on; `min_area_px` of them make a region; parts of one object may be
    `join_px` apart, and colour is looked at `color_margin_px` around them; `central` is the share of
    the image's sides looked at."""

    interval_s: float = 0.2
    slow_interval_s: float = 0.6
    tolerance_px: float = 1.0
    near_m: float = 0.22
    room_m: float = 1.2
    max_parallax_px: float = 5.0
    noise_factor: float = 5.0
    min_contrast: float = 8.0
    min_area_px: int = 16
    join_px: int = 4
    color_margin_px: int = 24
    central: float = 0.92

    def __post_init__(self) -> None:
        if not (
            0 < self.interval_s <= self.slow_interval_s
            and self.tolerance_px >= 0
            and self.min_area_px >= 1
            and 0 < self.central <= 1
        ):
            raise ValueError(
                f"{self}: expected rising positive intervals, a positive area, and a central share in (0, 1]"
            )


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
        self.ego = EgoMotion(camera)
        self._past: deque[_Past] = deque()
        self._slow_turn = False

    def step(self, image: Image, view: View, stamp_s: float, own: Mask | None = None) -> list[Region2D]:
        """Moving regions, strongest first; `own` (H, W) marks the robot's own body, which is no stimulus."""
        grey = np.asarray(cv2.blur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (3, 3)), dtype=np.uint8)
        present = _Past(image.copy(), grey, view, stamp_s, own)
        while self._past and stamp_s - self._past[0].stamp_s > 2 * self.params.slow_interval_s:
            self._past.popleft()  # from before something was tracked
        then = self._reference(present)
        regions = self._regions(then, present) if then else []
        self._past.append(present)
        return regions

    def _reference(self, now: _Past) -> _Past | None:
        """The image to compare with: as old as this turn wants and the head's motion allows."""
        p = self.params
        self._slow_turn = not self._slow_turn
        age_s = p.slow_interval_s if self._slow_turn else p.interval_s
        for past in self._past:  # oldest first
            if now.stamp_s - past.stamp_s <= age_s + 1e-6 and self._spread_px(past, now) <= p.max_parallax_px:
                return past
        return None

    def _spread_px(self, then: _Past, now: _Past) -> float:
        """How far apart the nearest and the farthest static things are after a warp."""
        return self.ego.parallax_px_m(then.view, now.view) / self.params.near_m

    def _regions(self, then: _Past, now: _Past) -> list[Region2D]:
        """What moved: first in grey, which mostly says that nothing did; what is left with its colours."""
        p = self.params
        height, width = now.grey.shape
        mx, my = round((1 - p.central) / 2 * width), round((1 - p.central) / 2 * height)
        central = (mx, my, width - mx, height - my)
        compare = _Comparison(p, self.ego, then, now)
        found = compare.unexplained(central, color=False)
        if found is None:
            return []
        x0, y0, x1, y1 = found[0]
        m = p.color_margin_px
        found = compare.unexplained(
            (max(x0 - m, mx), max(y0 - m, my), min(x1 + m, width - mx), min(y1 + m, height - my))
        )
        return self._split(*found) if found else []

    def _split(self, box: Box, surprise: NDArray[np.uint8]) -> list[Region2D]:
        """The connected regions of a surprise map of the pixels in `box`."""
        side = 2 * self.params.join_px + 1
        joined = cv2.morphologyEx((surprise > 0).view(np.uint8), cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(joined)
        regions = []
        for k in range(1, count):
            x, y, w, h = (int(value) for value in stats[k, :4])
            crop = np.s_[y : y + h, x : x + w]
            contrast = np.where(np.asarray(labels)[crop] == k, surprise[crop], 0)
            if np.count_nonzero(contrast) >= self.params.min_area_px:
                regions.append(Region2D((box[0] + x, box[1] + y, w, h), contrast > 0, float(contrast.sum())))
        return sorted(regions, key=lambda r: -r.evidence)


class _Comparison:
    """An older and the present image of one eye, seen from the present pose."""

    def __init__(self, params: TriggerParams, ego: EgoMotion, then: _Past, now: _Past) -> None:
        self.params, self.ego, self.then, self.now = params, ego, then, now
        self.still = ego.is_still(then.view, now.view)
        self.blind = self._own_bodies()
        self._levels: tuple[float, float] | None = None

    def unexplained(self, box: Box, color: bool = True) -> tuple[Box, NDArray[np.uint8]] | None:
        """The part of `box` where no distance explains the present pixels, and by how many levels each
        exceeds what they could be; None as soon as (nearly) everything is explained."""
        least: NDArray[np.uint8] | None = None
        for inverse_distance in self._inverse_distances():
            if color:
                old = cv2.blur(self._seen(self.then.image, inverse_distance, box), (3, 3))
                new = cv2.blur(self.now.image[_crop(box)], (3, 3))
            else:
                old, new = self._seen(self.then.grey, inverse_distance, box), self.now.grey[_crop(box)]
            surprise = self._surprise(np.asarray(old, dtype=np.uint8), np.asarray(new, dtype=np.uint8), box)
            least = surprise if least is None else np.minimum(least, surprise)
            if np.count_nonzero(least) < self.params.min_area_px:
                return None
            if not color:
                box, least = _shrunk(box, least)
        return None if least is None else (box, least)

    def _inverse_distances(self) -> list[float]:
        """1/m: the room's first, then all from infinity to the nearest, no further apart than the
        tolerance covers."""
        p = self.params
        spread_px = 0.0 if self.still else self.ego.parallax_px_m(self.then.view, self.now.view) / p.near_m
        steps = int(np.ceil(spread_px / (2 * p.tolerance_px)))
        return [1 / p.room_m, *(np.linspace(0, 1 / p.near_m, steps + 1) if steps else [])]

    def _seen(self, image: NDArray[np.uint8], inverse_distance: float, box: Box) -> NDArray[np.uint8]:
        if self.still:
            return image[_crop(box)]
        return self.ego.warp(image, self.then.view, self.now.view, inverse_distance, box)

    def _own_bodies(self) -> Mask | None:
        """Where the robot itself is, or was."""
        then, now = self.then.own, self.now.own
        if then is None or now is None or not then.any():
            return now
        if self.still:
            return then | now
        was = self.ego.warp(then.view(np.uint8), self.then.view, self.now.view, 1 / self.params.room_m)
        return now | was.view(bool)

    def _surprise(self, old: NDArray[np.uint8], new: NDArray[np.uint8], box: Box) -> NDArray[np.uint8]:
        """(h, w) by how many levels each pixel exceeds what the older image explains, noise included;
        of colour images (h, w, 3) the most of the three channels."""
        exposure, threshold = self._levels = self._levels or self._measure_levels(old, new)
        kernel = np.ones((2 * round(self.params.tolerance_px) + 1,) * 2, np.uint8)
        high, low = cv2.dilate(old, kernel), cv2.erode(old, kernel)
        if not self.still:  # what the older image did not see explains everything
            unseen = low == 0
            low[unseen], high[unseen] = 0, 255
        brighter = cv2.subtract(new, cv2.add(high, np.full(4, threshold + exposure)))
        darker = cv2.subtract(cv2.add(low, np.full(4, exposure - threshold)), new)
        surprise = np.asarray(cv2.max(brighter, darker), dtype=np.uint8)
        if surprise.ndim == 3:
            surprise = surprise.max(axis=2)
        if self.blind is not None:
            surprise[self.blind[_crop(box)]] = 0
        return surprise

    def _measure_levels(self, old: NDArray[np.uint8], new: NDArray[np.uint8]) -> tuple[float, float]:
        """How much brighter the image has become as a whole, and the change that is no noise."""
        difference = new[::6, ::6].astype(np.int16) - old[::6, ::6]
        exposure = float(np.median(difference))
        noise = 1.4826 * float(np.median(np.abs(difference - exposure)))
        return exposure, max(self.params.noise_factor * noise, self.params.min_contrast)


def _crop(box: Box) -> tuple[slice, slice]:
    return np.s_[box[1] : box[3], box[0] : box[2]]


def _shrunk(box: Box, surprise: NDArray[np.uint8]) -> tuple[Box, NDArray[np.uint8]]:
    """Only the rectangle in which anything is on."""
    x, y, w, h = cv2.boundingRect(surprise)
    return (box[0] + x, box[1] + y, box[0] + x + w, box[1] + y + h), surprise[y : y + h, x : x + w]
