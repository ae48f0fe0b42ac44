"""Motion trigger: regions of an image that move independently of the head.

R takes the residual of pyramidal Lucas–Kanade flow on a grid.  Here the eye's motion is known from the joints, so an
older image is warped to the present pose and subtracted (motion-compensated residual), first in grey at half the
resolution, then around the remaining residual in all pixels and colours.

Optical flow (Bouguet 2001), compensated for ego-motion, confirms the regions.  A point is matched if the flow from the
present image to the older one and back returns to it (forward–backward error, Kalal 2010).  It moves if its flow
differs from the median flow of the region's surroundings, so that an error of the eye's pose, which shifts the whole
image, moves nothing.  Points move together if one translation and expansion explain their flow: an object that comes
along the line of sight only expands.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import Camera, View, reduced_image
from pps_vision.geometry.masks import Box, BoxPx
from pps_vision.types import Array, Image, Mask
from tracking.camera_pose import ROOM_M, EgoMotion, channel_maximum

Grey = NDArray[np.uint8]  # (H, W)
_JITTER_S = 0.005  # of stamps
_WINDOW_PX = 9  # of Lucas–Kanade; R's 15 covers too much of the background of a region of 20 px
_MAX_POINTS = 40  # points in a region, and in the surroundings; limits the time
_MIN_POINTS = 4  # for a median, and that must move
_MARGIN_PX = 4  # nearer to a region a window contains much of it; around the boxes of followed objects
_FOLLOWED_MARGIN = 0.25  # the same, relative to their size
_EQUAL_PX = 0.5  # tolerance of equal flows
_EQUAL_SHARE = 0.15  # additional tolerance, as a share of the flow
Pixels = NDArray[np.uint8]  # (h, w) or (h, w, 3)
_FLOW_INTERVAL_S = 0.05  # age of the image from which flow is measured
_APART_S = 0.03  # between the images that are kept: memory does not grow with the frame rate
_COARSE = 2  # side of the coarse comparison's pixels, px
_COLOR_MARGIN_PX = 24  # around a coarse residual, in which all pixels and colours are compared


class Match(NamedTuple):
    """Number and share of a region's points that move together, and share without a match."""

    points: int
    moving: float
    unmatched: float


class GreyImage(NamedTuple):
    """A grey image, and the view it was taken from."""

    pixels: Grey
    view: View


def match(
    ego: EgoMotion,
    reference: GreyImage,
    current: GreyImage,
    room_m: float,
    tolerance_px: float,
    regions: Sequence[tuple[Box, Mask]],
) -> list[Match]:
    """Return how regions (x, y, width, height px; mask) of the present image have moved since an older one.

    The older image is warped to the present view as if everything were `room_m` away.  A point moves if its flow
    differs from that of the surroundings by more than `tolerance_px` and three of their standard deviations.
    """
    box = _surroundings([box for box, _ in regions], current.pixels.shape)
    old = np.ascontiguousarray(_cut(reference.pixels, box)) if ego.is_still(reference.view, current.view) else None
    if old is None:
        old = ego.warp(reference.pixels, reference.view, current.view, 1 / room_m, box)
    new = np.ascontiguousarray(_cut(current.pixels, box))
    outside = np.ones(new.shape, bool)
    grids = []
    for (x, y, w, h), mask in regions:
        top = y - box[1]
        left = x - box[0]
        outside[max(top - _MARGIN_PX, 0) : top + h + _MARGIN_PX, max(left - _MARGIN_PX, 0) : left + w + _MARGIN_PX] = (
            False
        )
        grids.append(_grid(mask) + np.array([left, top]))
    grids.append(_grid(outside))
    ends = np.cumsum([len(grid) for grid in grids])
    flow, matched = _lucas_kanade(new, old, np.concatenate(grids).astype(np.float32))
    static, spread = _median_flow(flow[ends[-2] :][matched[ends[-2] :]])
    threshold = max(tolerance_px, 3 * spread)
    matches = []
    for points, end in zip(grids[:-1], ends[:-1], strict=True):
        part = np.s_[end - len(points) : end]
        relative = flow[part] - static
        is_moving = matched[part] & (np.hypot(relative[:, 0], relative[:, 1]) > threshold)
        alike = _most_alike(points, relative, is_moving)
        matches.append(Match(int(np.count_nonzero(alike)), float(alike.mean()), 1 - float(matched[part].mean())))
    return matches


def _surroundings(boxes: list[Box], shape: tuple[int, ...]) -> Box:
    """Return x0, y0, x1, y1 around all boxes (x, y, width, height) and their surroundings."""
    x0 = min(x for x, _, _, _ in boxes)
    y0 = min(y for _, y, _, _ in boxes)
    x1 = max(x + width for x, _, width, _ in boxes)
    y1 = max(y + height for _, y, _, height in boxes)
    margin = max(20, max(x1 - x0, y1 - y0) // 2)
    return max(x0 - margin, 0), max(y0 - margin, 0), min(x1 + margin, shape[1]), min(y1 + margin, shape[0])


def _grid(mask: Mask) -> Array:
    """(n, 2) pixels x, y of a mask on a square grid, about `_MAX_POINTS` at most."""
    step = max(math.ceil(math.sqrt(np.count_nonzero(mask) / _MAX_POINTS)), 1)
    pixels = step * np.argwhere(mask[::step, ::step])[:, ::-1]
    return (pixels if len(pixels) else np.argwhere(mask)[:_MAX_POINTS, ::-1]).astype(float)


def _lucas_kanade(new: Grey, old: Grey, points: NDArray[np.float32]) -> tuple[Array, Mask]:
    """(n, 2) px flow of each point from `old` to `new`, and whether the point is matched."""
    window = (_WINDOW_PX, _WINDOW_PX)
    start = points.reshape(-1, 1, 2)
    end, status, _ = cv2.calcOpticalFlowPyrLK(new, old, start, np.empty(0), winSize=window)
    back, back_status, _ = cv2.calcOpticalFlowPyrLK(old, new, end, np.empty(0), winSize=window)
    error = np.linalg.norm((back - start)[:, 0], axis=1)
    matched = (status[:, 0] > 0) & (back_status[:, 0] > 0) & (error <= _EQUAL_PX)
    return (start - end)[:, 0].astype(float), matched


def _median_flow(flow: Array) -> tuple[Array, float]:
    """Median flow (2,) and standard deviation (from the median absolute deviation); 0 for too few points."""
    if len(flow) < _MIN_POINTS:
        return np.zeros(2), 0.0
    median = np.median(flow, axis=0)
    return median, 1.4826 * float(np.median(np.abs(flow - median)))


def _most_alike(points: Array, flow: Array, moving: Mask) -> Mask:
    """Largest subset of the moving points (n, 2) px whose flow (n, 2) px one translation and expansion explain.

    Hypotheses are the translation of each point, and translation and expansion of each point and a distant one.
    """
    if not moving.any():
        return moving
    p = points[moving]
    f = flow[moving]
    q, g = (np.roll(x, len(x) // 2, axis=0) for x in (p, f))
    distance = p - q
    expansion = np.sum((f - g) * distance, axis=1) / np.maximum(np.sum(distance**2, axis=1), 1)
    centers = np.concatenate([p, (p + q) / 2])
    shifts = np.concatenate([f, (f + g) / 2])
    expansions = np.concatenate([np.zeros(len(p)), expansion])[:, None, None]
    explained = shifts[:, None] + expansions * (points - centers[:, None])
    tolerance = _EQUAL_PX + _EQUAL_SHARE * np.linalg.norm(explained, axis=-1)
    agrees = (np.linalg.norm(explained - flow, axis=-1) <= tolerance) & moving
    best: Mask = agrees[agrees.sum(axis=1).argmax()]
    return best


@dataclass(frozen=True)
class TriggerParams:
    """Parameters of the motion trigger."""

    interval_s: float = 0.2
    """Age of the reference of every other image."""
    slow_interval_s: float = 0.6
    """Age of the reference of the images between, for slow or approaching objects."""
    near_m: float = 0.22
    """Distance of the nearest static object: the robot's own arms."""
    max_parallax_px: float = 5.0
    """Largest shift of an object at `near_m` between reference and image; a younger reference is used beyond it."""
    tolerance_px: float = 1.0
    """Error of the eye's pose in the image."""
    noise_factor: float = 5.0
    """Threshold of the residual, in standard deviations of the image noise."""
    min_contrast: float = 6.0
    """Smallest threshold of the residual, grey levels."""
    min_area_px: int = 16
    """Smallest region."""
    join_px: int = 2
    """Largest gap between parts of one region."""
    central: float = 0.92
    """Share of the image's sides that is compared; the border has often just come into view."""
    max_regions: int = 4
    """Largest number of reported regions, strongest first."""
    flow: bool = True
    """Whether optical flow confirms the regions."""
    min_moving: float = 0.25
    """Share of a region's matched points that must move together; a region with fewer matches than that moves too."""

    def __post_init__(self) -> None:
        if not (
            0 < self.interval_s <= self.slow_interval_s
            and self.tolerance_px > 0
            and self.min_area_px >= 1
            and 0 < self.central <= 1
            and self.max_regions >= 1
            and 0 < self.min_moving <= 1
        ):
            raise InputError(
                "motion trigger",
                f"{self}; expected rising positive intervals, a positive tolerance, area and number of regions, "
                "and shares in (0, 1]",
            )


@dataclass(frozen=True, slots=True)
class Region2D:
    """A motion region: box (x, y, width, height px), changed pixels (height, width), and summed residual."""

    box_px: tuple[int, int, int, int]
    mask: Mask
    evidence: float


@dataclass(frozen=True)
class _Frame:
    """An image and its view, with derived images that are computed when first needed."""

    image: Image
    view: View
    stamp_s: float
    own: Callable[[], Mask] | None
    followed: Sequence[BoxPx] = ()  # boxes of the objects that are followed

    @cached_property
    def coarse(self) -> Pixels:
        """Grey, `_COARSE` times smaller, smoothed."""
        small = cv2.cvtColor(reduced_image(self.image, _COARSE), cv2.COLOR_RGB2GRAY)
        return np.asarray(cv2.blur(small, (3, 3)), dtype=np.uint8)

    @cached_property
    def smooth(self) -> Pixels:
        """In colour, smoothed before any warp, so that the border of the warped image stays sharp."""
        return np.asarray(cv2.blur(self.image, (3, 3)), dtype=np.uint8)

    @cached_property
    def grey(self) -> GreyImage:
        """Grey image for optical flow."""
        pixels = np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
        return GreyImage(pixels, self.view)

    @cached_property
    def body(self) -> Mask | None:
        """Pixels of the robot's own body."""
        return self.own() if self.own else None


class MotionTrigger:
    """Finds motion regions in one eye's images; keeps the images of the last fraction of a second."""

    def __init__(self, params: TriggerParams, camera: Camera) -> None:
        self.params = params
        self._ego = EgoMotion(camera)
        self._coarse_ego = EgoMotion(camera.reduced(_COARSE))
        self._past: deque[_Frame] = deque()
        self._is_slow = False

    def step(
        self,
        image: Image,
        view: View,
        stamp_s: float,
        own: Callable[[], Mask] | None = None,
        confirm: bool = True,
        followed: Sequence[BoxPx] = (),
    ) -> list[Region2D]:
        """Return the motion regions, strongest first.

        Args:
            image: RGB.
            own: Returns the pixels (H, W) of the robot's own body, which is ignored; called only when needed.
            confirm: Drop regions that flow does not confirm.
            followed: Boxes of the objects that are followed, whose motion is no news.
        """
        current = self._next(image, view, stamp_s, own, followed)
        reference = self._reference(current)
        regions = self._regions(reference, current)[: self.params.max_regions] if reference else []
        if reference and regions and self.params.flow and confirm:
            regions = self._confirmed(reference, current, regions)
        for frame in (reference, current):  # large images that are soon computed again
            if frame is not None:
                frame.__dict__.pop("smooth", None)
                frame.__dict__.pop("grey", None)
        self._past.append(current)
        return regions

    def remember(
        self,
        image: Image,
        view: View,
        stamp_s: float,
        own: Callable[[], Mask] | None = None,
        followed: Sequence[BoxPx] = (),
    ) -> None:
        """Keep an image as a reference for later ones, without searching it."""
        self._past.append(self._next(image, view, stamp_s, own, followed))

    def before(self, stamp_s: float) -> tuple[Image, View] | None:
        """The oldest image of the last `interval_s` and its view; None if there is none."""
        frames = (frame for frame in self._past if 0 < stamp_s - frame.stamp_s <= self.params.interval_s + 1e-6)
        return next(((frame.image, frame.view) for frame in frames), None)

    def moves(self, mask: Mask, box: Box) -> bool:
        """Whether twice as many points of a mask (h, w) of a box of the last image move as rest, by their flow since
        `_FLOW_INTERVAL_S` or since the reference.  True if flow is off."""
        if not self.params.flow:
            return True
        last = self._past[-1]
        x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
        region = ((box[0] + x, box[1] + y, w, h), mask[y : y + h, x : x + w])
        for reference in (self._newest(last), self._reference(last)):
            if reference is not None and reference is not last:
                (flow,) = match(self._ego, reference.grey, last.grey, ROOM_M, self.params.tolerance_px, [region])
                if flow.moving > 2 * (1 - flow.unmatched - flow.moving):
                    return True
        return False

    def _next(
        self, image: Image, view: View, stamp_s: float, own: Callable[[], Mask] | None, followed: Sequence[BoxPx]
    ) -> _Frame:
        """Drop old images and return the new one; the next comparison has the other interval."""
        longest_s = self.params.slow_interval_s + 1e-6
        while len(self._past) > 1 and stamp_s - self._past[0].stamp_s > longest_s:
            if stamp_s - self._past[1].stamp_s <= _FLOW_INTERVAL_S - _JITTER_S:
                break  # flow is measured since the oldest one
            self._past.popleft()
        kept: list[_Frame] = []
        for frame in self._past:
            is_recent = stamp_s - frame.stamp_s <= self.params.interval_s + _JITTER_S
            apart_s = _APART_S if is_recent else 0.5 * self.params.slow_interval_s
            if not kept or frame.stamp_s - kept[-1].stamp_s > apart_s:
                kept.append(frame)
        self._past.clear()
        self._past.extend(kept)
        self._is_slow = not self._is_slow
        return _Frame(image.copy(), view, stamp_s, own, followed)

    def _newest(self, current: _Frame) -> _Frame | None:
        """Newest image that is `_FLOW_INTERVAL_S` old."""
        min_age_s = _FLOW_INTERVAL_S - _JITTER_S
        return next((frame for frame in reversed(self._past) if current.stamp_s - frame.stamp_s > min_age_s), None)

    def _reference(self, current: _Frame) -> _Frame | None:
        """Oldest image within the interval for which the head's motion causes little parallax."""
        p = self.params
        max_age_s = p.slow_interval_s if self._is_slow else p.interval_s
        for frame in self._past:  # oldest first
            if current.stamp_s - frame.stamp_s > max_age_s + 1e-6:
                continue
            if self._ego.parallax_px_m(frame.view, current.view) / p.near_m <= p.max_parallax_px:
                return frame
        return None

    def _regions(self, reference: _Frame, current: _Frame) -> list[Region2D]:
        """Regions of the residual: coarse, then around the coarse residual in all pixels and colours."""
        height = current.image.shape[0] // _COARSE
        width = current.image.shape[1] // _COARSE
        margin = (1 - self.params.central) / 2
        mx = round(margin * width)
        my = round(margin * height)
        coarse = MotionResidual(self.params, self._coarse_ego, reference, current, _COARSE)
        coarse_residual = coarse(reference.coarse, current.coarse, (mx, my, width - mx, height - my))
        if coarse_residual is None:
            return []
        fine = MotionResidual(self.params, self._ego, reference, current, 1)
        field = (_COARSE * mx, _COARSE * my, _COARSE * (width - mx), _COARSE * (height - my))
        regions: list[Region2D] = []
        for box in _boxes_around(*coarse_residual, field, coarse.min_area_px):
            residual = fine(reference.smooth, current.smooth, box)
            regions += self._split(*residual) if residual else []
        return sorted(regions, key=lambda region: -region.evidence)

    def _confirmed(self, reference: _Frame, current: _Frame, regions: list[Region2D]) -> list[Region2D]:
        """Regions that move by their flow.

        Flow is measured since the newest image that is `_FLOW_INTERVAL_S` old, and for slower regions since the
        reference.  Points without a match do not count, since a plain object shows flow at its edge only; but if most
        have none, the region moves.  Only in the former: since the reference, uncovered background has no match either.
        """
        least = self.params.min_moving
        newest = self._newest(current) or reference
        moves = [
            (match.points >= _MIN_POINTS and match.moving >= least * (1 - match.unmatched))
            or match.unmatched > 1 - least
            for match in self._matches(newest, current, regions)
        ]
        slow = [k for k, is_moving in enumerate(moves) if not is_moving]
        if slow and newest is not reference:
            matches = self._matches(reference, current, [regions[k] for k in slow])
            for k, match in zip(slow, matches, strict=True):
                moves[k] = match.moving >= least
        return [region for region, is_moving in zip(regions, moves, strict=True) if is_moving]

    def _matches(self, reference: _Frame, current: _Frame, regions: list[Region2D]) -> list[Match]:
        boxes = [(region.box_px, region.mask) for region in regions]
        return match(self._ego, reference.grey, current.grey, ROOM_M, self.params.tolerance_px, boxes)

    def _split(self, box: Box, residual: Pixels) -> list[Region2D]:
        """Connected regions of a residual in `box`."""
        closed = cv2.morphologyEx((residual > 0).view(np.uint8), cv2.MORPH_CLOSE, masks.square(self.params.join_px))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
        regions = []
        for k in range(1, count):
            x, y, w, h = (int(value) for value in stats[k, :4])
            crop = np.s_[y : y + h, x : x + w]
            contrast = np.where(np.asarray(labels)[crop] == k, residual[crop], 0)
            if np.count_nonzero(contrast) >= self.params.min_area_px:
                regions.append(Region2D((box[0] + x, box[1] + y, w, h), contrast > 0, float(contrast.sum())))
        return regions


class MotionResidual:
    """Motion-compensated residual of two images of one eye, in pixels `scale` times as large as the camera's.

    Each pixel is compared with the range of the older image within the tolerated error of the pose, for every distance
    that static objects may have.
    """

    def __init__(self, params: TriggerParams, ego: EgoMotion, reference: _Frame, current: _Frame, scale: int) -> None:
        self._params = params
        self._ego = ego
        self._reference = reference
        self._current = current
        self._scale = scale
        self._tolerance_px = params.tolerance_px / scale
        self.min_area_px = -(-params.min_area_px // scale**2)
        self._is_still = ego.is_still(reference.view, current.view)
        self._levels: tuple[float, float] | None = None

    def __call__(self, old: Pixels, new: Pixels, box: Box) -> tuple[Box, Pixels] | None:
        """Return the part of `box` with a residual at every distance, and the smallest of these residuals (grey
        levels); None as soon as fewer than the smallest region's pixels remain."""
        smallest: Pixels | None = None
        for inverse_distance in self._inverse_distances():
            residual = self._at(old, new, inverse_distance, box)
            smallest = self._without_followed(residual, box) if smallest is None else np.minimum(smallest, residual)
            if np.count_nonzero(smallest) < self.min_area_px:
                return None
            box, smallest = _shrunk(box, smallest)
        if smallest is None or np.count_nonzero(self._without_body(smallest, box)) < self.min_area_px:
            return None
        return _shrunk(box, smallest)

    def _inverse_distances(self) -> list[float]:
        """1/m: the room's first, then from the nearest to infinity in steps that the tolerance covers."""
        p = self._params
        spread_px = (
            0.0 if self._is_still else self._ego.parallax_px_m(self._reference.view, self._current.view) / p.near_m
        )
        steps = int(np.ceil(spread_px / (2 * self._tolerance_px)))
        return [1 / ROOM_M, *(np.linspace(1 / p.near_m, 0, steps + 1) if steps else [])]

    def _at(self, old: Pixels, new: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """(h, w) grey levels by which each pixel of the box lies outside the older image's range at that distance, 0
        below the noise threshold; of colour images (H, W, 3) the largest of the three channels."""
        pixels = _cut(new, box)
        warped, low, high = self._range(old, inverse_distance, box)
        if self._levels is None:
            self._levels = self._measure_levels(warped, pixels)
        exposure, threshold = self._levels
        if exposure:
            pixels = np.clip(pixels - np.float32(exposure), 0, 255).astype(np.uint8)
        difference = cv2.max(cv2.subtract(pixels, high), cv2.subtract(low, pixels))
        residual = np.asarray(cv2.threshold(difference, threshold, 0, cv2.THRESH_TOZERO)[1], dtype=np.uint8)
        return residual if residual.ndim == 2 else channel_maximum(residual)

    def _range(self, old: Pixels, inverse_distance: float, box: Box) -> tuple[Pixels, Pixels, Pixels]:
        """The warped older image in the box, and its darkest and brightest level within the tolerance; all levels
        where it has no pixels."""
        m = int(np.ceil(self._tolerance_px))
        x0, y0, x1, y1 = box
        left = min(m, x0)
        top = min(m, y0)
        wide_box = (x0 - left, y0 - top, min(x1 + m, old.shape[1]), min(y1 + m, old.shape[0]))
        warped = self._warped(old, inverse_distance, wide_box)
        kernel = masks.square(m)
        low = np.asarray(cv2.erode(warped, kernel), np.uint8)
        high = np.asarray(cv2.dilate(warped, kernel), np.uint8)
        unknown = None if self._is_still else low == 0
        if self._tolerance_px < m:  # a fraction of the way to the darkest or brightest neighbour
            share = self._tolerance_px / m
            low = np.asarray(cv2.addWeighted(warped, 1 - share, low, share, 0), np.uint8)
            high = np.asarray(cv2.addWeighted(warped, 1 - share, high, share, 0), np.uint8)
        if unknown is not None:
            low[unknown] = 0
            high[unknown] = 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        return warped[inside], low[inside], high[inside]

    def _warped(self, old: Pixels, inverse_distance: float, box: Box) -> Pixels:
        """The box of the older image, warped to the present view; 0 where it has no pixels."""
        if self._is_still:
            return _cut(old, box)
        return self._ego.warp(old, self._reference.view, self._current.view, inverse_distance, box)

    def _measure_levels(self, reference: Pixels, current: Pixels) -> tuple[float, float]:
        """Change of the exposure, and noise threshold of the residual, grey levels."""
        difference = current[::6, ::6].astype(np.int16) - reference[::6, ::6]
        exposure = _median(difference)
        noise = 1.4826 * _median(np.abs(difference - exposure))  # standard deviation, from the absolute deviation
        return exposure, max(self._params.noise_factor * noise, self._params.min_contrast)

    def _without_followed(self, residual: Pixels, box: Box) -> Pixels:
        """The residual without the objects that are followed, and the places where they were."""
        view = self._reference.view
        boxes = list(self._current.followed)
        for x, y, w, h in self._reference.followed:
            behind = view.center + ROOM_M * view.rays(np.array([x + 0.5 * w, y + 0.5 * h]))
            u, v = self._current.view.project(behind)
            boxes += [(u - 0.5 * w, v - 0.5 * h, w, h)] if np.isfinite(u) else []
        for x, y, w, h in boxes:
            margin = _FOLLOWED_MARGIN * max(w, h) + _MARGIN_PX
            sides = x - margin, y - margin, x + w + margin, y + h + margin
            left, top, right, bottom = (int(side / self._scale) for side in sides)
            rows = slice(max(top - box[1], 0), max(bottom - box[1], 0))
            residual[rows, max(left - box[0], 0) : max(right - box[0], 0)] = 0
        return residual

    def _without_body(self, residual: Pixels, box: Box) -> Pixels:
        """The residual without the robot's own body, present and past; evaluated last, because it costs most."""
        step = np.s_[:: self._scale, :: self._scale]
        if self._current.body is not None:
            residual[_cut(self._current.body[step], box)] = 0
        if self._reference.body is not None and self._reference.body.any():
            old_body = self._warped(self._reference.body[step].view(np.uint8), 1 / ROOM_M, box)
            residual[old_body.view(bool)] = 0
        return residual


def _boxes_around(box: Box, residual: Pixels, field: Box, min_px: int) -> list[Box]:
    """Disjoint parts of `field`, px, around the blobs of `min_px` or more of a coarse residual (h, w) of `box`,
    largest first."""
    count, _, stats, _ = cv2.connectedComponentsWithStats((residual > 0).view(np.uint8))
    boxes: list[Box] = []
    for x, y, w, h, area in stats[1:count].tolist():
        if area < min_px:
            continue
        part = (
            max(_COARSE * (box[0] + x) - _COLOR_MARGIN_PX, field[0]),
            max(_COARSE * (box[1] + y) - _COLOR_MARGIN_PX, field[1]),
            min(_COARSE * (box[0] + x + w) + _COLOR_MARGIN_PX, field[2]),
            min(_COARSE * (box[1] + y + h) + _COLOR_MARGIN_PX, field[3]),
        )
        while overlapping := [earlier for earlier in boxes if _overlap(part, earlier)]:
            boxes = [earlier for earlier in boxes if earlier not in overlapping]
            x0, y0, x1, y1 = zip(part, *overlapping, strict=True)
            part = (min(x0), min(y0), max(x1), max(y1))
        boxes.append(part)
    return sorted(boxes, key=lambda b: (b[0] - b[2]) * (b[3] - b[1]))


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _median(values: NDArray[Any]) -> float:
    """The upper median: several times faster than NumPy's for a few hundred values."""
    return float(np.partition(values, values.size // 2, axis=None)[values.size // 2])


def _cut(image: NDArray[Any], box: Box) -> NDArray[Any]:
    return image[box[1] : box[3], box[0] : box[2]]


def _shrunk(box: Box, residual: Pixels) -> tuple[Box, Pixels]:
    """Crop to the rectangle around the residual."""
    x, y, w, h = cv2.boundingRect(residual)
    return (box[0] + x, box[1] + y, box[0] + x + w, box[1] + y + h), residual[y : y + h, x : x + w]
