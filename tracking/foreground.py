"""Foreground of one camera: its image's difference from the background, and the objects that move in front of it.

The background is the mean image of the static scene at an anchor, the camera's pose at the last update.  It is warped
to the current pose, which is the anchor itself as long as the camera rests.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.masks import Box, BoxPx
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask
from tracking.appearance import N_BINS, ColorModel, color_bins, histogram
from tracking.camera_pose import ROOM_M, EgoMotion, channel_maximum, color_difference

_SAMPLES = 20  # per row and column, of brightness, noise and distance
_EDGE_PX = 4  # within which smoothing mixes colours
_STRIP = 64  # rows of the background that are updated together
# Excess of the likeness (Bhattacharyya coefficient) of a ghost and its surroundings over that in the background.  In
# 3200 outlines of 27 films (seeds 8202, 2016, 2017) no object has more than 0.23, most ghosts have 0.5 to 0.8.
_GHOST = 0.3
_COMMON = 0.3  # share of colours that an object and its ghost have in common, at least
_RAGGED = 0.05  # width of parts that colours of the surroundings leave, relative to the root of the area
_AROUND = 0.35  # width of these surroundings, relative to the root of the ghost's area
SOLID = 0.9  # solidity below which a moving region may be an object and its holder
HIDING = 0.3  # foreground around an object from which it may hide a part
_AROUND_PX = (3, 6)
_INVERSE_DISTANCES = np.linspace(0, 2, 11)  # static scene, 1/m

Pixels = NDArray[np.uint8]  # (h, w, 3)


@dataclass(frozen=True)
class ForegroundParams:
    """Parameters of the foreground."""

    memory_s: float = 0.3
    """Interval between updates of the background; pixels unchanged since the last update become background."""
    rate: float = 0.3
    """Weight of a new image in the mean."""
    noise_factor: float = 4.0
    """Threshold of the difference from the background, standard deviations."""
    min_contrast: float = 3.0
    """Its minimum, grey levels."""
    tolerance_px: int = 2
    """Tolerated shift between the background and the image of a moving camera."""
    min_overlap: float = 0.8
    """Least overlap of a colour region with a moving object that it shows."""
    min_moved: float = 0.05
    """Least share of a moving object's image that was background 0.2 s earlier: 2 cm/s are 8 % of 6 cm."""
    max_area_ratio: float = 2.0
    """Largest ratio of the areas that a moving object covers and uncovers."""

    def __post_init__(self) -> None:
        if not (
            self.memory_s > 0
            and 0 < self.rate <= 1
            and min(self.noise_factor, self.min_contrast, self.tolerance_px) > 0
            and 0 < self.min_overlap < 1
            and 0 < self.min_moved < 1
            and self.max_area_ratio > 1
        ):
            raise InputError(
                "foreground",
                f"{self}; expected positive numbers, a rate up to 1, shares below 1, and a ratio above 1",
            )


class Brightness(NamedTuple):
    """Brightness of an image relative to the background, and the threshold of their difference, grey levels."""

    gain: float
    threshold: float


class Background:
    """Mean colours (H, W, 3) of the static scene, smoothed over 3×3 px; 0 where they are unknown.

    A pixel is updated if it equals the background or its colour at the last update, or if it is unknown; not near the
    followed objects.  The scene is assumed at one distance, at which the last update fits a moving camera's image best.
    """

    def __init__(self, params: ForegroundParams, camera: Camera) -> None:
        self.params = params
        self.is_known = False  # whether anything was learned
        self._ego = EgoMotion(camera)
        self._anchor = View(camera, np.eye(4))
        self._mean = self._last = np.empty((0, 0, 3), np.uint8)  # and the image of the last update
        self._stamp_s = 0.0
        self._inverse_distance = 1 / ROOM_M
        self._measured: tuple[Image, Brightness] | None = None
        self._expected: tuple[View, Box, Pixels] | None = None  # the last part of the mean that was warped to a view
        columns, rows = (
            (2 * np.arange(_SAMPLES) + 1) * (side - 2) // (2 * _SAMPLES) + 1 for side in (camera.width, camera.height)
        )
        self._samples = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)

    def rests(self, view: View) -> bool:
        """Whether the background was learned at this pose of the camera."""
        return self.is_known and self._ego.is_still(self._anchor, view)

    def evidence(self, image: Image, view: View, box: Box) -> NDArray[np.float32]:
        """Probability (h, w) that a pixel of a box is foreground: ½ at the threshold, 0 below half of it, 1 where the
        background is unknown."""
        gain, threshold = self.brightness(image, view)
        share = np.arange(256, dtype=np.float32) / np.float32(2 * threshold)
        share[share <= 0.25] = 0
        return np.take(np.minimum(share, 1), self._difference(smoothed(image, box), self._mean, gain, view, box))

    def differs(self, image: Image, view: View, box: Box) -> Mask:
        """Foreground mask (h, w) of a box; all pixels where the background is unknown."""
        return self.differed(image, view, view, box)

    def differed(self, image: Image, view: View, current_view: View, box: Box) -> Mask:
        """`differs` for an image of another view, in a box of the current view."""
        gain, threshold = self.brightness(image, view)
        if self._ego.is_still(view, current_view):
            pixels = smoothed(image, box)
        else:
            warped = self._ego.warp(image, view, current_view, 1 / ROOM_M, box)
            pixels = np.asarray(cv2.blur(warped, (3, 3)), np.uint8)
        mask: Mask = self._difference(pixels, self._mean, gain, current_view, box) > int(threshold)
        return mask

    def knows(self, view: View, box: Box) -> Mask:
        """Mask (h, w) of the pixels of a box whose background is known."""
        return np.asarray(self._warped(self._mean, view, box)[..., 0] > 0)

    def is_ghost(self, image: Image, view: View, mask: Mask, box: Box) -> bool:
        """Whether a foreground mask (h, w) of a box is the place that an object has left since the background was
        learned: its colours are those around it, in the background they are not."""
        now, learned, around = self._colors(image, view, mask, box)
        inside = ~masks.dilated(~mask, 2) & (learned < N_BINS)
        alike, was_alike = (ColorModel(histogram(bins, inside), around).similarity(around) for bins in (now, learned))
        return bool(inside.any() and alike - was_alike > _GHOST)

    def own_and_ghost(self, image: Image, view: View, mask: Mask, box: Box) -> tuple[Mask, Mask]:
        """Parts (h, w) of a foreground mask of a box: in the colours of its object, and those that the object has left
        since the background was learned (none if background and image have few colours in common): now in other
        colours, in the background in the object's."""
        now, learned, around = self._colors(image, view, mask, box)
        common = np.minimum(histogram(now, mask), histogram(learned, mask & (learned < N_BINS)))
        if common.sum() < _COMMON:
            return mask, np.zeros_like(mask)
        is_own = np.append(ColorModel(common / common.sum(), around).table() > 0.5, False)
        return mask & is_own[now], masks.opened(mask & ~is_own[now] & is_own[learned], 1)

    def _colors(
        self, image: Image, view: View, mask: Mask, box: Box
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], Array]:
        """Colour bins (h, w) of a box in the image and in the background, and the histogram around a mask (h, w)."""
        expected = cv2.convertScaleAbs(self._warped(self._mean, view, box), alpha=self.brightness(image, view).gain)
        now, learned = (color_bins(np.asarray(pixels, np.uint8)) for pixels in (smoothed(image, box), expected))
        learned[expected[..., 0] == 0] = N_BINS
        reach = max(int(_AROUND * math.sqrt(np.count_nonzero(mask))), _EDGE_PX)
        return now, learned, histogram(now, masks.dilated(mask, reach) & ~masks.dilated(mask, 2))

    def adopt(self, image: Image, view: View, mask: Mask, box: Box) -> None:
        """Take a mask (h, w) of a box of the image for background, if the camera rests."""
        if self.rests(view):
            self._mean[box[1] : box[3], box[0] : box[2]][mask] = np.maximum(smoothed(image, box), np.uint8(1))[mask]

    def brightness(self, image: Image, view: View) -> Brightness:
        """Brightness of an image and the threshold, from sampled pixels."""
        if self._measured is None or self._measured[0] is not image:
            self._measured = image, self._brightness(image, view)
        return self._measured[1]

    def _brightness(self, image: Image, view: View) -> Brightness:
        sources = self._samples.astype(float)
        if not self.rests(view):
            sources = self._ego.project(self._directions, self._anchor, view, self._inverse_distance)
        gain, noise = _gain_and_noise(image, self._samples, self._mean, sources)
        return Brightness(gain, max(self.params.noise_factor * noise, self.params.min_contrast))

    def update(self, image: Image, view: View, stamp_s: float, objects_px: Sequence[BoxPx] = ()) -> None:
        """Update the background every `memory_s`, except around the boxes of the followed objects."""
        if self.is_known and stamp_s - self._stamp_s <= self.params.memory_s - 1e-6:
            return
        current = smoothed(image, (0, 0, image.shape[1], len(image)))
        np.maximum(current, np.uint8(1), out=current)
        excluded = np.zeros(image.shape[:2], bool)
        for x, y, w, h in objects_px:
            excluded[
                max(int(y - 0.3 * h), 0) : max(int(y + 1.3 * h), 0), max(int(x - 0.3 * w), 0) : max(int(x + 1.3 * w), 0)
            ] = True
        if self.is_known:
            self._mean, self._last = self._updated(image, current, view, excluded)
        else:
            self._mean = np.where(excluded[..., None], np.uint8(0), current)
            self._last = current
        self._anchor = view
        self._stamp_s = stamp_s
        self._measured = self._expected = None
        self.is_known = True

    def invalidate_mask(
        self, image: Image, view: View, mask: Mask, box: Box, is_alike: Callable[[Pixels], Mask]
    ) -> None:
        """Mark the background as unknown where the object may have been at rest during learning: where it, a mask
        (h, w) of a box, equals the background (if the camera has moved since: has the background's colours), and where
        the background has its colours and the image does not.

        Args:
            is_alike: Pixels (h, w, 3) → mask (h, w) of the object's colours.
        """
        if not self.is_known:
            return
        if not self.rests(view):
            had_its_colors = masks.opened(is_alike(self._warped(self._mean, view, box)), 1)
            forgotten = np.zeros(image.shape[:2], np.uint8)
            forgotten[box[1] : box[3], box[0] : box[2]] = had_its_colors & (mask | ~is_alike(smoothed(image, box)))
            self._mean[self._ego.warp(forgotten, view, self._anchor, self._inverse_distance) > 0] = 0
            self._expected = None
            return
        learned = self._mean[box[1] : box[3], box[0] : box[2]]
        differs = self.differs(image, view, box)
        former = masks.dilated(masks.hull(masks.opened(is_alike(learned) & differs, 1)), _EDGE_PX)
        learned[(mask & ~differs) | ((mask | differs) & former)] = 0

    def invalidate(self, image: Image, view: View, box_px: BoxPx) -> None:
        """Mark the background as unknown behind an object's box and in the foreground within two box sizes: the object
        may have been at rest there during learning."""
        if not self.rests(view):
            return
        x, y, w, h = (max(round(value), 0) for value in box_px)
        box = masks.clipped((x - 2 * w, y - 2 * h, x + 3 * w, y + 3 * h), image.shape[1], len(image))
        doubtful = self.differs(image, view, box)
        doubtful[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = True
        self._mean[box[1] : box[3], box[0] : box[2]][doubtful] = 0

    def _updated(self, image: Image, current: Pixels, view: View, excluded: Mask) -> tuple[Pixels, Pixels]:
        """Background as seen from a view, and the image (smoothed: `current`) at the background's brightness."""
        if not self.rests(view):
            self._fit_distance(current, view)
            self._expected = None
        gain, threshold = self._brightness(image, view)
        saturated = channel_maximum(current) == 255
        cv2.convertScaleAbs(current, current, alpha=1 / gain)
        np.maximum(current, np.uint8(1), out=current)
        whole = (0, 0, current.shape[1], current.shape[0])
        mean = self._warped(self._mean, view, whole)
        rows = _STRIP if self.rests(view) else len(current)  # strips take less memory
        strips = [(0, y, whole[2], min(y + rows, whole[3])) for y in range(0, whole[3], rows)]
        differences = [self._difference(current[box[1] : box[3]], self._mean, 1.0, view, box) for box in strips]
        differs = np.concatenate(differences) > int(threshold)
        moved = differs & (mean[..., 0] > 0) & ~excluded
        x, y, w, h = cv2.boundingRect(moved.view(np.uint8))
        if w:
            part = x, y, x + w, y + h
            inside = np.s_[y : y + h, x : x + w]
            moved[inside] &= self._difference(current[inside], self._last, 1.0, view, part) > int(threshold)
        if gain > 1:
            moved |= saturated
        updated = np.asarray(cv2.addWeighted(current, self.params.rate, mean, 1 - self.params.rate, 0), np.uint8)
        cv2.copyTo(current, differs.view(np.uint8), updated)
        cv2.copyTo(mean, (moved | excluded).view(np.uint8), updated)
        return updated, current

    def _fit_distance(self, current: Pixels, view: View) -> None:
        """Set the distance at which the image of the last update fits best."""
        rays = view.rays(self._samples.astype(float))
        colors = current[self._samples[:, 1], self._samples[:, 0]].astype(np.float32)

        def difference(inverse_distance: float) -> float:
            points = view.center + rays / max(inverse_distance, 1e-3)
            return color_difference(colors, points, self._last, self._anchor)

        self._inverse_distance = min((self._inverse_distance, *_INVERSE_DISTANCES.tolist()), key=difference)

    def _difference(self, current: Pixels, reference: Pixels, gain: float, view: View, box: Box) -> NDArray[np.uint8]:
        """Largest difference (h, w) of the three channels of a box (its pixels `current`) to the range of `reference`
        times the gain within the tolerance, grey levels; 255 where the reference is unknown."""
        is_moving = not self.rests(view)
        m = self.params.tolerance_px if is_moving else 1
        x0, y0, x1, y1 = box
        left = min(m, x0)
        top = min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, reference.shape[1]), min(y1 + m, len(reference))
        expected = self._warped(reference, view, wide)
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        low = cv2.erode(expected, masks.square(m))[inside]
        is_unknown = low[..., 0] == 0
        below = channel_maximum(cv2.subtract(cv2.convertScaleAbs(low, alpha=gain), current))
        del low  # large
        high = cv2.dilate(expected, masks.square(m))[inside]
        above = channel_maximum(cv2.subtract(current, cv2.convertScaleAbs(high, alpha=gain)))
        difference = np.asarray(cv2.max(above, below), np.uint8)
        if is_moving:  # gaps that the tolerance leaves along edges
            difference = np.asarray(cv2.morphologyEx(difference, cv2.MORPH_CLOSE, masks.square(m + 1)), np.uint8)
        difference[is_unknown] = 255
        return difference

    def _warped(self, image: Pixels, view: View, box: Box) -> Pixels:
        """Box of an image of the anchor, warped to a view."""
        if self.rests(view):
            return image[box[1] : box[3], box[0] : box[2]]
        if image is not self._mean:
            return self._ego.warp(image, self._anchor, view, self._inverse_distance, box)
        if self._expected is None or self._expected[0] is not view or not masks.contains(self._expected[1], box):
            self._expected = view, box, self._ego.warp(image, self._anchor, view, self._inverse_distance, box)
        _, (x, y, _, _), expected = self._expected
        return expected[box[1] - y : box[3] - y, box[0] - x : box[2] - x]

    @cached_property
    def _directions(self) -> Array:
        """(n, 3) directions of the sampled pixels."""
        return self._ego.camera.bearings(self._samples.astype(float))


@dataclass(frozen=True)
class Foreground:
    """Foreground of an image (H, W, 3) and of an earlier one with its view (None: there is none).

    A moving object covers background that was visible in the earlier image, and uncovers background that it hid there.
    """

    background: Background
    image: Image
    view: View
    earlier: tuple[Image, View] | None

    def differs(self, box: Box) -> Mask:
        """Foreground mask (h, w) of a box."""
        return self.background.differs(self.image, self.view, box)

    def covers(self, box: Box) -> Mask:
        """Foreground mask (h, w) of a box where the background is known."""
        return self.differs(box) & self.background.knows(self.view, box)

    def confirms(self, colored: Mask, box: Box) -> bool:
        """Whether a colour region (h, w) in `box` may be a moving object: the hull of the foreground that touches it
        encloses it (the inside of a uniform object need not be foreground), and it has the object's colours where its
        ghost tells them.  Before a moving camera it may: optical flow decides.
        """
        if not self.background.rests(self.view):
            return True
        differs = self.differs(box)
        _, labels = cv2.connectedComponents(differs.view(np.uint8))
        touching = np.isin(labels, np.unique(np.asarray(labels)[colored & differs])) & differs
        if not touching.any():
            return False
        if np.count_nonzero(masks.hull(touching) & colored) < SOLID * np.count_nonzero(colored):
            return False
        whole = masks.filled(touching | colored)
        own, ghost = self.background.own_and_ghost(self.image, self.view, whole, box)
        return bool(not ghost.any() or 2 * np.count_nonzero(colored & own) > np.count_nonzero(colored))

    def shows_the_object(self, colored: Mask, moved: Mask) -> bool:
        """Whether a colour region (h, w) is the object of the foreground `moved` (h, w): both are nearly equal, or the
        foreground is not solid, such as an arm that holds an object."""
        overlap = np.count_nonzero(colored & moved) / np.count_nonzero(colored | moved)
        return bool(overlap > self.background.params.min_overlap or masks.solidity(moved) < SOLID)

    def moved_mask(self, seed: Mask, box: Box) -> tuple[Mask, bool] | None:
        """Mask (h, w) of the object that moved onto the `seed` (h, w) in `box`, and whether a part of it may be hidden.

        It has covered background, and uncovered about as much.  If it has not uncovered as much, it appears from behind
        an occluder; only in front of a static camera, and away from the border of the box.  None for other objects, and
        for the place that an object has left.
        """
        background = self.background
        rests = background.rests(self.view)
        x0, y0, x1, y1 = box
        m = max(x1 - x0, y1 - y0) if rests else 0  # motion of a fast object
        around = masks.clipped((x0 - m, y0 - m, x1 + m, y1 + m), self.image.shape[1], len(self.image))
        inside = np.s_[y0 - around[1] : y1 - around[1], x0 - around[0] : x1 - around[0]]
        differs = self.differs(around)
        mask = masks.closed_component(differs[inside], seed)
        if mask is None or self.earlier is None:
            return None
        differed = background.differed(*self.earlier, self.view, around)
        covered = np.count_nonzero(mask & ~differed[inside])
        uncovered = np.count_nonzero(differed & ~differs)
        ratio = background.params.max_area_ratio
        if covered <= background.params.min_moved * np.count_nonzero(mask):
            return None
        if background.is_ghost(self.image, self.view, mask, box):
            return None
        _, ghost = background.own_and_ghost(self.image, self.view, mask, box)
        if ghost.any():
            rest = masks.opened(mask & ~ghost, max(int(_RAGGED * math.sqrt(np.count_nonzero(mask))), 1))
            mask = masks.closed_component(rest, rest)
            if mask is None:
                return None
        is_whole = covered / ratio < uncovered < ratio * covered
        if is_whole and rests:
            return mask, False
        if masks.solidity(mask) < SOLID:
            return None
        if rests:
            is_cut = mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()
            return None if is_cut else (mask, True)
        return (mask, False) if is_whole else None


@njit(cache=True, error_model="numpy")
def _gain_and_noise(image: Image, pixels: NDArray[np.int64], mean: Image, sources: Array) -> tuple[float, float]:
    """Median ratio of an image (H, W, 3), smoothed over 3×3 px, to the background at pixels (n, 2) of both, (x, y),
    and the standard deviation of what remains; 1 and 0 if the background is unknown.  NaN and pixels outside the
    background have none."""
    height, width = image.shape[:2]
    levels = np.empty((len(pixels), 3))
    expected = np.empty((len(pixels), 3))
    n = 0
    for i in range(len(pixels)):
        x, y = pixels[i, 0], pixels[i, 1]
        if not (-0.5 < sources[i, 0] < width - 0.5 and -0.5 < sources[i, 1] < height - 0.5):
            continue
        u, v = int(np.rint(sources[i, 0])), int(np.rint(sources[i, 1]))
        if min(mean[v, u, 0], mean[v, u, 1], mean[v, u, 2]) == 0:
            continue
        for k in range(3):
            expected[n, k] = mean[v, u, k]
            total = 0
            for row in range(y - 1, y + 2):
                for column in range(x - 1, x + 2):
                    total += image[row, column, k]
            levels[n, k] = total / 9
        n += 1
    if n == 0:
        return 1.0, 0.0
    gain = np.median((levels[:n] / expected[:n]).ravel())
    noise = 1.4826 * np.median(np.abs(levels[:n] - gain * expected[:n]).ravel())
    return gain, noise


def smoothed(image: Image, box: Box) -> Pixels:
    """Box (h, w, 3) of an image, smoothed over 3×3 px."""
    x0, y0, x1, y1 = box
    left, top, right, bottom = max(x0 - 1, 0), max(y0 - 1, 0), min(x1 + 1, image.shape[1]), min(y1 + 1, len(image))
    smooth = np.asarray(cv2.blur(image[top:bottom, left:right], (3, 3)), np.uint8)
    return np.ascontiguousarray(smooth[y0 - top : y1 - top, x0 - left : x1 - left])


def foreground_around(mask: Mask, foreground: Mask) -> float:
    """Share of what surrounds an object's mask (h, w), beyond the reach of smoothing, that is foreground."""
    around = masks.dilated(mask, _AROUND_PX[1]) & ~masks.dilated(mask, _AROUND_PX[0])
    return float(np.count_nonzero(foreground & around)) / max(float(np.count_nonzero(around)), 1.0)
