"""What moves by itself: the part of an image that the head's own motion does not explain.

R uses the residual of pyramidal Lucas–Kanade flow on a grid (FACTS §4).  Here the eye's motion is
known from the joints, so an older image is warped to the present pose, and a pixel is on where it is
brighter or darker than anything the older image had within the tolerated pose error, at whatever
distance things may be.  A coarse grey look comes first, for it mostly says that nothing moves; only where
it does not, and it is not the robot itself, all pixels and colours are compared.  Optical flow confirms what that
residual leaves, and measures how it moves.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.ego_motion import Box, EgoMotion
from tracking.flow import JITTER_S, Flow2D, FlowParams, Match, Shot, match
from tracking.surprise import Comparison, Limits, Pixels


@dataclass(frozen=True)
class TriggerParams:
    """`interval_s` and `slow_interval_s`: how old an image is compared, in turns, the latter for slow
    or looming objects; younger ones while the head moves so fast that static things, which may be as
    near as `near_m` before a room about `room_m` away, uncover more than `max_parallax_px` of it.
    `tolerance_px` of pose error; `noise_factor` times the image noise, or at least `min_contrast` grey
    levels, switch a pixel on; `min_area_px` of them make a region; parts of one object may be
    `join_px` apart, and colour is looked at `color_margin_px` around them; `central` is the share of
    the image's sides looked at, at first in pixels `coarse` times as large, where `coarse_contrast` will do;
    `flow` confirms and measures regions (None: they are reported as the residual leaves them)."""

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
    flow: FlowParams | None = field(default_factory=FlowParams)

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
    """A moving patch: box (x, y, width, height px), which pixels of it are on (height, width), their summed
    contrast, and its optical flow; None where it moves too fast for that, or flow is off."""

    box_px: tuple[int, int, int, int]
    mask: Mask
    evidence: float
    flow: Flow2D | None = None


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
    def shot(self) -> Shot:
        """In grey, as it is."""
        return Shot(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8), self.view, self.stamp_s)

    @cached_property
    def _body(self) -> Mask | None:
        return self.own() if self.own else None

    def body(self, scale: int) -> Mask | None:
        """Where the robot is in the image, in pixels `scale` times as large."""
        return None if self._body is None else self._body[::scale, ::scale]


class Trigger:
    """Finds moving regions in one eye's images; remembers the last fraction of a second."""

    def __init__(self, params: TriggerParams, camera: Camera) -> None:
        self.params = params
        self._ego, self._coarse_ego = EgoMotion(camera), EgoMotion(camera.reduced(params.coarse))
        self._past: deque[_Past] = deque()
        self._slow_turn = False

    def step(
        self,
        image: Image,
        view: View,
        stamp_s: float,
        own: Callable[[], Mask] | None = None,
        look: bool = True,
        confirm: bool = True,
    ) -> list[Region2D]:
        """Moving regions, strongest first; `own` tells where (H, W) the robot's own body is, which is no
        stimulus.  With `look` off the image is only remembered; with `confirm` off flow measures, and refutes
        nothing."""
        present = _Past(image.copy(), view, stamp_s, own, self.params.coarse)
        while self._past and stamp_s - self._past[0].stamp_s > 2 * self.params.slow_interval_s:
            self._past.popleft()  # from before something was tracked
        self._slow_turn = not self._slow_turn
        then = self._reference(present) if look else None
        regions = self._regions(then, present) if then else []
        if then and regions and self.params.flow:
            regions = self._confirmed(self.params.flow, then, present, regions, confirm)
        self._past.append(present)
        return regions

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
        compare = self._comparison(then, now, p.coarse)
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
        found = self._comparison(then, now, 1).unexplained(then.smooth, now.smooth, box)
        return self._split(*found) if found else []

    def _confirmed(
        self, params: FlowParams, then: _Past, now: _Past, regions: list[Region2D], confirm: bool
    ) -> list[Region2D]:
        """The regions that flow shows to move, with their flow; all, where it need not `confirm` them.

        It is measured since the newest image that is `interval_s` old; of what is too slow to move since then, since
        the image that the residual was computed with.  Only in the former does a missing match tell of motion: in the
        other, what has been uncovered in between has none either.
        """
        newest = next(
            (past for past in reversed(self._past) if now.stamp_s - past.stamp_s > params.interval_s - JITTER_S), then
        )
        matches = self._matches(params, newest, now, regions[: params.max_regions])
        slow = [
            k
            for k, one in enumerate(matches)
            if one.moving < params.min_moving and one.unmatched < params.min_unmatched
        ]
        confirmed = {k: replace(regions[k], flow=one.flow) for k, one in enumerate(matches) if k not in slow}
        if slow and newest is not then:
            again = self._matches(params, then, now, [regions[k] for k in slow])
            found = zip(slow, again, strict=True)
            confirmed |= {k: replace(regions[k], flow=one.flow) for k, one in found if one.moving >= params.min_moving}
        return [confirmed.get(k, region) for k, region in enumerate(regions) if k in confirmed or not confirm]

    def _matches(self, params: FlowParams, then: _Past, now: _Past, regions: list[Region2D]) -> list[Match]:
        pairs = [(region.box_px, region.mask) for region in regions]
        return match(params, self._ego, then.shot, now.shot, self.params.room_m, pairs)

    def _comparison(self, then: _Past, now: _Past, scale: int) -> Comparison:
        """In pixels `scale` times as large as the image's."""
        p, ego = self.params, self._ego if scale == 1 else self._coarse_ego
        contrast = p.coarse_contrast if scale > 1 else p.min_contrast
        area = -(-p.min_area_px // scale**2)
        limits = Limits(p.tolerance_px / scale, p.noise_factor, contrast, area, p.near_m, p.room_m)
        return Comparison(limits, ego, then.view, now.view, lambda: (then.body(scale), now.body(scale)))

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
