"""What moves by itself: the part of an image that the head's own motion does not explain.

R uses the residual of pyramidal Lucas–Kanade flow on a grid (FACTS §4).  Here the eye's motion is
known from the joints, so an older image is warped to the present pose, and a pixel is on where it is
brighter or darker than anything the older image had within the tolerated pose error, at whatever
distance things may be.  A coarse grey look comes first, for it mostly says that nothing moves; only where
it does not, and it is not the robot itself, all pixels and colours are compared.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.ego_motion import Box, EgoMotion

Pixels = NDArray[np.uint8]  # (h, w) or (h, w, 3)


@dataclass(frozen=True)
class TriggerParams:
    """`interval_s` and `slow_interval_s`: how old an image is compared, in turns, the latter for slow
    or looming objects; younger ones while the head moves so fast that static things, which may be as
    near as `near_m` before a room about `room_m` away, uncover more than `max_parallax_px` of it.
    `tolerance_px` of pose error; `noise_factor` times the image noise, or at least `min_contrast` grey
    levels, switch a pixel on; `min_area_px` of them make a region; parts of one object may be
    `join_px` apart, and colour is looked at `color_margin_px` around them; `central` is the share of
    the image's sides looked at, at first in pixels `coarse` times as large, where `coarse_contrast` will do."""

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
    coarse: int = 2
    coarse_contrast: float = 6.0

    def __post_init__(self) -> None:
        if not (
            0 < self.interval_s <= self.slow_interval_s
            and self.tolerance_px > 0
            and self.min_area_px >= 1
            and self.coarse >= 1
            and 0 < self.central <= 1
        ):
            raise ValueError(
                f"{self}: expected rising positive intervals, a positive tolerance, area and coarseness, "
                "and a central share in (0, 1]"
            )


@dataclass(frozen=True, slots=True)
class Region2D:
    """A moving patch: box (x, y, width, height px), which pixels of it are on (height, width), and
    their summed contrast."""

    box_px: tuple[int, int, int, int]
    mask: Mask
    evidence: float


@dataclass(frozen=True)
class _Past:
    """An image and whence it was taken; what is worth keeping of it is computed when it is asked for."""

    image: Image
    view: View
    stamp_s: float
    own: Callable[[], Mask] | None
    coarse: int

    @cached_property
    def overview(self) -> Pixels:
        """Grey and `coarse` times smaller, smoothed."""
        height, width = (side // self.coarse for side in self.image.shape[:2])
        small = self.image[: height * self.coarse, : width * self.coarse]
        if self.coarse > 1:
            small = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        return np.asarray(cv2.blur(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), (3, 3)), dtype=np.uint8)

    @cached_property
    def smooth(self) -> Pixels:
        """In colour, noise smoothed; before a warp, lest what the warp cannot see be smeared in."""
        return np.asarray(cv2.blur(self.image, (3, 3)), dtype=np.uint8)

    @cached_property
    def body(self) -> Mask | None:
        """Where the robot is in the image."""
        return self.own() if self.own else None


class Trigger:
    """Finds moving regions in one eye's images; remembers the last fraction of a second."""

    def __init__(self, params: TriggerParams, camera: Camera) -> None:
        self.params = params
        self._ego, self._coarse_ego = EgoMotion(camera), EgoMotion(camera.reduced(params.coarse))
        self._past: deque[_Past] = deque()
        self._slow_turn = False

    def step(
        self, image: Image, view: View, stamp_s: float, own: Callable[[], Mask] | None = None, look: bool = True
    ) -> list[Region2D]:
        """Moving regions, strongest first; `own` tells where (H, W) the robot's own body is, which is no
        stimulus.  With `look` off the image is only remembered."""
        present = _Past(image.copy(), view, stamp_s, own, self.params.coarse)
        while self._past and stamp_s - self._past[0].stamp_s > 2 * self.params.slow_interval_s:
            self._past.popleft()  # from before something was tracked
        self._slow_turn = not self._slow_turn
        then = self._reference(present) if look else None
        self._past.append(present)
        return self._regions(then, present) if then else []

    def _reference(self, now: _Past) -> _Past | None:
        """The image to compare with: as old as this turn wants and the head's motion allows."""
        p = self.params
        age_s = p.slow_interval_s if self._slow_turn else p.interval_s
        for past in self._past:  # oldest first
            if now.stamp_s - past.stamp_s > age_s + 1e-6:
                continue
            if self._ego.parallax_px_m(past.view, now.view) / p.near_m <= p.max_parallax_px:
                return past
        return None

    def _regions(self, then: _Past, now: _Past) -> list[Region2D]:
        """What moved: first at a coarse grey look; where that leaves something, with all pixels and colours."""
        p = self.params
        height, width = now.overview.shape
        mx, my = round((1 - p.central) / 2 * width), round((1 - p.central) / 2 * height)
        compare = _Comparison(p, self._coarse_ego, then, now, p.coarse, p.coarse_contrast)
        found = compare.unexplained(then.overview, now.overview, (mx, my, width - mx, height - my))
        if found is None:
            return []
        (x0, y0, x1, y1), m, k = found[0], p.color_margin_px, p.coarse
        box = (
            max(k * x0 - m, k * mx),
            max(k * y0 - m, k * my),
            min(k * x1 + m, k * (width - mx)),
            min(k * y1 + m, k * (height - my)),
        )
        compare = _Comparison(p, self._ego, then, now, 1, p.min_contrast)
        found = compare.unexplained(then.smooth, now.smooth, box)
        return self._split(*found) if found else []

    def _split(self, box: Box, surprise: Pixels) -> list[Region2D]:
        """The connected regions of a surprise map of the pixels in `box`."""
        closed = cv2.morphologyEx((surprise > 0).view(np.uint8), cv2.MORPH_CLOSE, masks.square(self.params.join_px))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
        regions = []
        for k in range(1, count):
            x, y, w, h = (int(value) for value in stats[k, :4])
            crop = np.s_[y : y + h, x : x + w]
            contrast = np.where(np.asarray(labels)[crop] == k, surprise[crop], 0)
            if np.count_nonzero(contrast) >= self.params.min_area_px:
                regions.append(Region2D((box[0] + x, box[1] + y, w, h), contrast > 0, float(contrast.sum())))
        return sorted(regions, key=lambda r: -r.evidence)


class _Comparison:
    """An older and the present image of one eye, seen from the present pose, in pixels `scale` times as large."""

    def __init__(
        self, params: TriggerParams, ego: EgoMotion, then: _Past, now: _Past, scale: int, min_contrast: float
    ) -> None:
        self.params, self.ego, self.then, self.now = params, ego, then, now
        self.scale, self.min_contrast = scale, min_contrast
        self.min_area = -(-params.min_area_px // scale**2)
        self.reach = params.tolerance_px / scale
        self.still = ego.is_still(then.view, now.view)
        self._levels: tuple[float, float] | None = None

    def unexplained(self, old: Pixels, new: Pixels, box: Box) -> tuple[Box, Pixels] | None:
        """The part of `box` where no distance explains the present pixels, and by how many levels each
        exceeds what they could be; None as soon as (nearly) everything is explained."""
        least: Pixels | None = None
        for inverse_distance in self._inverse_distances():
            surprise = self._surprise(old, new, inverse_distance, box)
            least = surprise if least is None else np.minimum(least, surprise)
            if np.count_nonzero(least) < self.min_area:
                return None
            box, least = _shrunk(box, least)
        if least is None or np.count_nonzero(self._elsewhere(least, box)) < self.min_area:
            return None
        return _shrunk(box, least)

    def _inverse_distances(self) -> list[float]:
        """1/m: the room's first, then all from the nearest, where the robot's own arms are, to infinity, no
        further apart than the tolerance covers."""
        p = self.params
        spread_px = 0.0 if self.still else self.ego.parallax_px_m(self.then.view, self.now.view) / p.near_m
        steps = int(np.ceil(spread_px / (2 * self.reach)))
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
        m = int(np.ceil(self.reach))
        x0, y0, x1, y1 = box
        left, top = min(m, x0), min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, old.shape[1]), min(y1 + m, old.shape[0])
        seen = self._then_seen(old, inverse_distance, wide)
        kernel = masks.square(m)
        low, high = (np.asarray(one, np.uint8) for one in (cv2.erode(seen, kernel), cv2.dilate(seen, kernel)))
        unseen = None if self.still else low == 0
        if self.reach < m:  # a fraction of the way to the darkest or brightest neighbour
            share = self.reach / m
            low, high = (np.asarray(cv2.addWeighted(seen, 1 - share, one, share, 0), np.uint8) for one in (low, high))
        if unseen is not None:
            low[unseen], high[unseen] = 0, 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        return seen[inside], low[inside], high[inside]

    def _then_seen(self, old: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """What the older image has in the box as it would be seen now; 0 where it does not reach."""
        return (
            _cut(old, box) if self.still else self.ego.warp(old, self.then.view, self.now.view, inverse_distance, box)
        )

    def _measure_levels(self, then: Pixels, now: Pixels) -> tuple[float, float]:
        """How much brighter the image has become as a whole, and the change that is no noise."""
        difference = now[::6, ::6].astype(np.int16) - then[::6, ::6]
        exposure = _median(difference)
        noise = 1.4826 * _median(np.abs(difference - exposure))
        return exposure, max(self.params.noise_factor * noise, self.min_contrast)

    def _elsewhere(self, surprise: Pixels, box: Box) -> Pixels:
        """The same with nothing surprising where the robot itself is, or was: asked last, for it costs most."""
        then, now = self.then.body, self.now.body
        every = np.s_[:: self.scale, :: self.scale]
        if now is not None:
            surprise[_cut(now[every], box)] = 0
        if then is not None and then.any():
            was = then[every].view(np.uint8)
            surprise[self._then_seen(was, 1 / self.params.room_m, box).view(bool)] = 0
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
