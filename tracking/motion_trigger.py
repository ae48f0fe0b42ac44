"""Motion trigger: regions of an image that move by themselves, while the head may move too.

R takes the residual of pyramidal Lucas–Kanade flow on a grid.  Here the eye's motion is known from the joints, so an
older image is warped to the present pose and compared (the motion-compensated residual), first in grey at half the
resolution; only where that leaves something are all pixels and colours compared.  Optical flow then confirms the
regions and measures their image velocity (`optical_flow`).
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View, reduced_image
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.ego_motion import ROOM_M, Box, EgoMotion
from tracking.moving_background import most
from tracking.optical_flow import JITTER_S, Flow2D, GreyImage, Match, match

Pixels = NDArray[np.uint8]  # (h, w) or (h, w, 3)
_FLOW_INTERVAL_S = 0.05  # age of the image from which flow is measured
_COARSE = 2  # side of the coarse comparison's pixels, px
_COLOR_MARGIN_PX = 24  # around a coarse residual, in which all pixels and colours are compared
_WIDER_THAN_A_STRIP = np.ones((2, 2), np.uint8)


@dataclass(frozen=True)
class TriggerParams:
    """What the motion trigger compares, and what it takes for motion."""

    interval_s: float = 0.2
    """Age of the image that every other image is compared with."""
    slow_interval_s: float = 0.6
    """Age of the image that the others are compared with: for slow or approaching objects."""
    near_m: float = 0.22
    """Distance of the nearest static thing: the robot's own arms."""
    max_parallax_px: float = 5.0
    """A younger image is compared while the eye translates so fast that things at `near_m` shift by more."""
    tolerance_px: float = 1.0
    """Error of the eye's pose in the image."""
    noise_factor: float = 5.0
    """Residual, in standard deviations of the image noise, from which a pixel has changed."""
    min_contrast: float = 6.0
    """The same at least, in grey levels."""
    min_area_px: int = 16
    """Smallest region."""
    join_px: int = 2
    """Parts of one region may be so far apart."""
    central: float = 0.92
    """Share of the image's sides that is compared; what is beyond has often just come into view."""
    max_regions: int = 4
    """Only so many regions are reported, the strongest."""
    flow: bool = True
    """Whether optical flow confirms and measures the regions."""
    min_moving: float = 0.25
    """Share of a region's matched points that must move alike; if fewer than that of all have a match, it moves too."""

    def __post_init__(self) -> None:
        if not (
            0 < self.interval_s <= self.slow_interval_s
            and self.tolerance_px > 0
            and self.min_area_px >= 1
            and 0 < self.central <= 1
            and self.max_regions >= 1
            and 0 < self.min_moving <= 1
        ):
            raise ValueError(
                f"{self}: expected rising positive intervals, a positive tolerance, area and number of regions, "
                "and shares in (0, 1]"
            )


@dataclass(frozen=True, slots=True)
class Region2D:
    """A motion region: box (x, y, width, height px), its changed pixels (height, width), their summed residual, and its
    optical flow; None where it moves too fast for that, or flow is off."""

    box_px: tuple[int, int, int, int]
    mask: Mask
    evidence: float
    flow: Flow2D | None = None


@dataclass(frozen=True)
class _Past:
    """An image and its view; what is derived from it is computed when first needed."""

    image: Image
    view: View
    stamp_s: float
    own: Callable[[], Mask] | None

    @cached_property
    def coarse(self) -> Pixels:
        """Grey, `_COARSE` times smaller, smoothed."""
        small = cv2.cvtColor(reduced_image(self.image, _COARSE), cv2.COLOR_RGB2GRAY)
        return np.asarray(cv2.blur(small, (3, 3)), dtype=np.uint8)

    @cached_property
    def smooth(self) -> Pixels:
        """In colour, smoothed before any warp, which leaves the border of what it cannot see sharp."""
        return np.asarray(cv2.blur(self.image, (3, 3)), dtype=np.uint8)

    @cached_property
    def grey(self) -> GreyImage:
        """For optical flow."""
        pixels = np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
        return GreyImage(pixels, self.view, self.stamp_s)

    @cached_property
    def body(self) -> Mask | None:
        """Where the robot sees itself."""
        return self.own() if self.own else None


class MotionTrigger:
    """Finds motion regions in one eye's images; remembers the last fraction of a second."""

    def __init__(self, params: TriggerParams, camera: Camera) -> None:
        self.params = params
        self._ego, self._coarse_ego = EgoMotion(camera), EgoMotion(camera.reduced(_COARSE))
        self._past: deque[_Past] = deque()
        self._is_slow = False

    def step(
        self, image: Image, view: View, stamp_s: float, own: Callable[[], Mask] | None = None, confirm: bool = True
    ) -> list[Region2D]:
        """Return the motion regions, strongest first.

        Args:
            image: RGB.
            own: Returns the pixels (H, W) of the robot's own body, which is no stimulus; called only when needed.
            confirm: Whether regions that flow does not confirm are dropped.
        """
        now = self._next(image, view, stamp_s, own)
        then = self._reference(now)
        regions = self._regions(then, now)[: self.params.max_regions] if then else []
        if then and regions and self.params.flow:
            regions = self._confirmed(then, now, regions, confirm)
        self._past.append(now)
        return regions

    def remember(self, image: Image, view: View, stamp_s: float, own: Callable[[], Mask] | None = None) -> None:
        """Keep an image to compare later ones with, without looking for motion in it."""
        self._past.append(self._next(image, view, stamp_s, own))

    def image_before(self, view: View, stamp_s: float) -> Image | None:
        """Return the oldest image since `interval_s` before, of an eye that has not moved; None if there is none."""
        still = (one.image for one in self._within_interval(stamp_s) if self._ego.is_still(one.view, view))
        return next(still, None)

    def seen_before(self, view: View, stamp_s: float, box: Box) -> Image | None:
        """Return a box of the oldest image since `interval_s` before as seen from `view`; None if there is none."""
        one = next(self._within_interval(stamp_s), None)
        return None if one is None else self._ego.warp(one.image, one.view, view, 1 / ROOM_M, box)

    def _within_interval(self, stamp_s: float) -> Iterator[_Past]:
        """The images since `interval_s` before, oldest first."""
        return (one for one in self._past if 0 < stamp_s - one.stamp_s <= self.params.interval_s + 1e-6)

    def moves(self, mask: Mask, box: Box) -> bool:
        """Whether flow, unless it is off, shows that of a mask (h, w) of a box of the last image more than twice as
        many points move by themselves as rest: since `_FLOW_INTERVAL_S`, or since the image that the last one was
        compared with."""
        if not self.params.flow:
            return True
        now, p = self._past[-1], self.params
        x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
        region = (box[0] + x, box[1] + y, w, h), mask[y : y + h, x : x + w]
        for then in (self._newest(now), self._reference(now)):
            if then is not None and then is not now:
                (found,) = match(self._ego, then.grey, now.grey, ROOM_M, p.tolerance_px, [region])
                if found.moving > 2 * (1 - found.unmatched - found.moving):
                    return True
        return False

    def _next(self, image: Image, view: View, stamp_s: float, own: Callable[[], Mask] | None) -> _Past:
        """The image to keep, after old ones were dropped; the next comparison has the other interval."""
        while self._past and stamp_s - self._past[0].stamp_s > 2 * self.params.slow_interval_s:
            self._past.popleft()
        self._is_slow = not self._is_slow
        return _Past(image.copy(), view, stamp_s, own)

    def _newest(self, now: _Past) -> _Past | None:
        """The newest image that is `_FLOW_INTERVAL_S` old."""
        least_s = _FLOW_INTERVAL_S - JITTER_S
        return next((one for one in reversed(self._past) if now.stamp_s - one.stamp_s > least_s), None)

    def _reference(self, now: _Past) -> _Past | None:
        """The image to compare with: as old as its interval says and the head's motion allows."""
        p = self.params
        age_s = p.slow_interval_s if self._is_slow else p.interval_s
        for one in self._past:  # oldest first
            if now.stamp_s - one.stamp_s > age_s + 1e-6:
                continue
            if self._ego.parallax_px_m(one.view, now.view) / p.near_m <= p.max_parallax_px:
                return one
        return None

    def _regions(self, then: _Past, now: _Past) -> list[Region2D]:
        """Regions of the residual, first of the coarse images; around what that leaves, of all pixels and colours."""
        p, (height, width) = self.params, now.image.shape[:2]
        mx, my = (round((1 - p.central) / 2 * (side // _COARSE)) for side in (width, height))
        coarse = Residual(p, self._coarse_ego, then, now, _COARSE)
        left = coarse(then.coarse, now.coarse, (mx, my, width // _COARSE - mx, height // _COARSE - my))
        if left is None:
            return []
        fine, regions = Residual(p, self._ego, then, now, 1), []
        field = _COARSE * mx, _COARSE * my, _COARSE * (width // _COARSE - mx), _COARSE * (height // _COARSE - my)
        for box in _surroundings(*left, field, coarse.min_area_px):
            found = fine(then.smooth, now.smooth, box)
            regions += self._split(*found) if found else []
        return sorted(regions, key=lambda r: -r.evidence)

    def _confirmed(self, then: _Past, now: _Past, regions: list[Region2D], confirm: bool) -> list[Region2D]:
        """The regions that move according to flow, with their flow; all of them, if it need not `confirm`.

        Flow is measured since the newest image that is `_FLOW_INTERVAL_S` old; of what is too slow to move since then,
        since the image of the residual.  Only in the former does a missing match mean motion: in the latter, what has
        been uncovered in between has none either.
        """
        p = self.params
        newest = self._newest(now) or then
        matches = self._matches(newest, now, regions)
        confirmed = {
            k: replace(regions[k], flow=one.flow)
            for k, one in enumerate(matches)
            if self._moves(one) or one.unmatched > 1 - p.min_moving
        }
        slow = [k for k in range(len(regions)) if k not in confirmed]
        if slow and newest is not then:
            found = zip(slow, self._matches(then, now, [regions[k] for k in slow]), strict=True)
            confirmed |= {k: replace(regions[k], flow=one.flow) for k, one in found if one.moving >= p.min_moving}
        return [confirmed.get(k, region) for k, region in enumerate(regions) if k in confirmed or not confirm]

    def _moves(self, one: Match) -> bool:
        """Whether enough of a region's matched points move alike.  Points without a match count neither way: a plain
        object shows flow at its edge only, and has no match where it covers and uncovers its background."""
        return one.flow is not None and one.moving >= self.params.min_moving * (1 - one.unmatched)

    def _matches(self, then: _Past, now: _Past, regions: list[Region2D]) -> list[Match]:
        boxes = [(region.box_px, region.mask) for region in regions]
        return match(self._ego, then.grey, now.grey, ROOM_M, self.params.tolerance_px, boxes)

    def _split(self, box: Box, residual: Pixels) -> list[Region2D]:
        """The connected regions of a residual in `box`, without strips one pixel wide: what an error of the pose beyond
        the tolerance leaves along an edge at rest."""
        eroded = cv2.erode((residual > 0).view(np.uint8), _WIDER_THAN_A_STRIP)
        wide = cv2.dilate(eroded, _WIDER_THAN_A_STRIP, anchor=(0, 0))  # an even kernel's opening needs both corners
        residual = np.where(wide, residual, np.uint8(0))
        closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, masks.square(self.params.join_px))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
        regions = []
        for k in range(1, count):
            x, y, w, h = (int(value) for value in stats[k, :4])
            crop = np.s_[y : y + h, x : x + w]
            contrast = np.where(np.asarray(labels)[crop] == k, residual[crop], 0)
            if np.count_nonzero(contrast) >= self.params.min_area_px:
                regions.append(Region2D((box[0] + x, box[1] + y, w, h), contrast > 0, float(contrast.sum())))
        return regions


class Residual:
    """Motion-compensated residual of two images of one eye, in pixels `scale` times as large as the camera's.

    An image is compared with what the older one had within the tolerated error of the pose, for every distance that
    static things may have.
    """

    def __init__(self, params: TriggerParams, ego: EgoMotion, then: _Past, now: _Past, scale: int) -> None:
        self._params, self._ego, self._then, self._now, self._scale = params, ego, then, now, scale
        self._tolerance_px = params.tolerance_px / scale
        self.min_area_px = -(-params.min_area_px // scale**2)
        self._is_still = ego.is_still(then.view, now.view)
        self._levels: tuple[float, float] | None = None

    def __call__(self, old: Pixels, new: Pixels, box: Box) -> tuple[Box, Pixels] | None:
        """Return the part of `box` with a residual at every distance, and the least of these residuals (grey levels);
        None as soon as fewer than the smallest region's pixels are left."""
        least: Pixels | None = None
        for inverse_distance in self._inverse_distances():
            residual = self._at(old, new, inverse_distance, box)
            least = residual if least is None else np.minimum(least, residual)
            if np.count_nonzero(least) < self.min_area_px:
                return None
            box, least = _shrunk(box, least)
        if least is None or np.count_nonzero(self._without_body(least, box)) < self.min_area_px:
            return None
        return _shrunk(box, least)

    def _inverse_distances(self) -> list[float]:
        """1/m: the room's first, then from the nearest to infinity in steps that the tolerance covers."""
        p = self._params
        spread_px = 0.0 if self._is_still else self._ego.parallax_px_m(self._then.view, self._now.view) / p.near_m
        steps = int(np.ceil(spread_px / (2 * self._tolerance_px)))
        return [1 / ROOM_M, *(np.linspace(1 / p.near_m, 0, steps + 1) if steps else [])]

    def _at(self, old: Pixels, new: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """(h, w) grey levels by which each pixel of the box is brighter or darker than the older image can be at that
        distance, 0 where that may be noise; of colour images (H, W, 3) the largest of the three channels."""
        now = _cut(new, box)
        then, low, high = self._range(old, inverse_distance, box)
        exposure, threshold = self._levels = self._levels or self._measure_levels(then, now)
        if exposure:
            now = np.clip(now - np.float32(exposure), 0, 255).astype(np.uint8)
        beyond = cv2.max(cv2.subtract(now, high), cv2.subtract(low, now))
        residual = np.asarray(cv2.threshold(beyond, threshold, 0, cv2.THRESH_TOZERO)[1], dtype=np.uint8)
        return residual if residual.ndim == 2 else most(residual)

    def _range(self, old: Pixels, inverse_distance: float, box: Box) -> tuple[Pixels, Pixels, Pixels]:
        """The older image at each pixel of the box, and its darkest and brightest level within the tolerance; all
        levels where it does not reach."""
        m = int(np.ceil(self._tolerance_px))
        x0, y0, x1, y1 = box
        left, top = min(m, x0), min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, old.shape[1]), min(y1 + m, old.shape[0])
        seen = self._warped(old, inverse_distance, wide)
        kernel = masks.square(m)
        low, high = (np.asarray(one, np.uint8) for one in (cv2.erode(seen, kernel), cv2.dilate(seen, kernel)))
        unseen = None if self._is_still else low == 0
        if self._tolerance_px < m:  # a fraction of the way to the darkest or brightest neighbour
            share = self._tolerance_px / m
            low, high = (np.asarray(cv2.addWeighted(seen, 1 - share, one, share, 0), np.uint8) for one in (low, high))
        if unseen is not None:
            low[unseen], high[unseen] = 0, 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        return seen[inside], low[inside], high[inside]

    def _warped(self, old: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """The box of the older image as seen from the present view; 0 where it does not reach."""
        if self._is_still:
            return _cut(old, box)
        return self._ego.warp(old, self._then.view, self._now.view, inverse_distance, box)

    def _measure_levels(self, then: Pixels, now: Pixels) -> tuple[float, float]:
        """How much brighter the image has become as a whole, and the change that is no noise."""
        difference = now[::6, ::6].astype(np.int16) - then[::6, ::6]
        exposure = _median(difference)
        noise = 1.4826 * _median(np.abs(difference - exposure))  # standard deviation, from the absolute deviation
        return exposure, max(self._params.noise_factor * noise, self._params.min_contrast)

    def _without_body(self, residual: Pixels, box: Box) -> Pixels:
        """The residual, 0 where the robot itself is or was: evaluated last, because it costs most."""
        step = np.s_[:: self._scale, :: self._scale]
        if self._now.body is not None:
            residual[_cut(self._now.body[step], box)] = 0
        if self._then.body is not None and self._then.body.any():
            was = self._warped(self._then.body[step].view(np.uint8), 1 / ROOM_M, box)
            residual[was.view(bool)] = 0
        return residual


def _surroundings(box: Box, residual: Pixels, field: Box, least_px: int) -> list[Box]:
    """The parts of `field`, px, around the blobs of a coarse residual (h, w) of `box`, largest first; none overlap.

    A blob of fewer than `least_px` coarse pixels has none.
    """
    count, _, stats, _ = cv2.connectedComponentsWithStats((residual > 0).view(np.uint8))
    k, m = _COARSE, _COLOR_MARGIN_PX
    boxes: list[Box] = []
    for x, y, w, h, area in stats[1:count].tolist():
        if area < least_px:
            continue
        left, top = max(k * (box[0] + x) - m, field[0]), max(k * (box[1] + y) - m, field[1])
        one = left, top, min(k * (box[0] + x + w) + m, field[2]), min(k * (box[1] + y + h) + m, field[3])
        while near := [other for other in boxes if _overlap(one, other)]:
            boxes = [other for other in boxes if other not in near]
            x0, y0, x1, y1 = zip(one, *near, strict=True)
            one = min(x0), min(y0), max(x1), max(y1)
        boxes.append(one)
    return sorted(boxes, key=lambda b: (b[0] - b[2]) * (b[3] - b[1]))


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _median(values: NDArray[Any]) -> float:
    """The upper median: several times faster than NumPy's for a few hundred values."""
    return float(np.partition(values, values.size // 2, axis=None)[values.size // 2])


def _cut(image: NDArray[Any], box: Box) -> NDArray[Any]:
    return image[box[1] : box[3], box[0] : box[2]]


def _shrunk(box: Box, residual: Pixels) -> tuple[Box, Pixels]:
    """Only the rectangle around the residual."""
    x, y, w, h = cv2.boundingRect(residual)
    return (box[0] + x, box[1] + y, box[0] + x + w, box[1] + y + h), residual[y : y + h, x : x + w]
