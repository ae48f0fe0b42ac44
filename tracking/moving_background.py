"""Background model of a moving camera: an earlier image warped to the current pose."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.background_edge import GHOST_EDGE, MIN_GHOST_PX, edge_of_background
from tracking.ego_motion import ROOM_M, Box, EgoMotion, color_difference

# Chosen on independent films of seeds 7000-7005 (a grey ball before moving eyes).
_PERIOD_S = 0.5  # what looks the same in two images so far apart is background
_ROOM_STD = 0.1  # 1/m by which most static things differ from the fitted distance, `ROOM_M` at first
_NEARNESS, _MUCH_BETTER = np.linspace(0, 2, 11), 0.95  # 1/m that are tried; fit beside the present one's
_LEAST_PX, _MOST_PX = 1, 3  # error of the pose and of the distance that is tolerated
_NOISE_FACTOR, _MIN_CONTRAST, _MAX_CONTRAST = 5.0, 6.0, 15.0  # as `TriggerParams`; and grey levels at most
_STEP = 16  # px between the samples of noise and distance
_KEPT = 0.3  # margin around the tracked object's box, relative to it, that is not updated

Pixels = NDArray[np.uint8]  # (h, w, 3)
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height


class MovingBackground:
    """Colours of the static scene in one moving camera's images, smoothed over 3×3 px, at an anchor (a recent pose).

    Every `_PERIOD_S` the current pose becomes the anchor.  A pixel is updated if it equals the background or the
    anchor's image, or belongs to a ghost, but not at the tracked object.  The scene is assumed at one distance,
    the one at which the anchor's image fits best.
    """

    def __init__(self, ego: EgoMotion) -> None:
        self.is_known = False  # whether anything was learned; what follows means nothing before
        self._ego, self._anchor, self._stamp_s = ego, View(ego.camera, np.eye(4)), 0.0
        self._mean = self._recent = np.empty((0, 0, 3), np.uint8)
        self._known = np.empty((0, 0), np.uint8)  # 255 where the mean is known
        self._threshold, self._nearness = _MIN_CONTRAST, 1 / ROOM_M

    def evidence(self, image: Image, view: View, box: Box) -> NDArray[np.float32]:
        """Probability (h, w) that a pixel of a box is foreground, as `Background.evidence`; 0 where unknown."""
        over, known = self._beyond(smoothed(image, box), self._mean, view, box)
        share = np.minimum(over * np.float32(0.5 / self._threshold), 1)
        return np.asarray(np.where(known & (share > 0.25), share, 0), np.float32)

    def differs(self, image: Image, view: View, box: Box) -> Mask:
        """Foreground mask (h, w) of a box; all pixels where the background is unknown."""
        return self._differs(smoothed(image, box), view, box)

    def differs_in(self, part: Image, view: View, box: Box) -> Mask:
        """`differs` for the image `part` of a box."""
        return self._differs(np.asarray(cv2.blur(part, (3, 3)), np.uint8), view, box)

    def seen(self, view: View, box: Box) -> NDArray[np.float32]:
        """Background (h, w, 3) as seen from a view; -1 where it is unknown."""
        mean = self._warped(self._mean, view, box).astype(np.float32)
        mean[self._warped(self._known, view, box) < 255] = -1.0
        return mean

    def start(self, mean: NDArray[np.float32], view: View, stamp_s: float) -> None:
        """Initialize from the mean (H, W, 3) of a static camera, below 0 where it is unknown."""
        self._mean = np.clip(np.rint(mean), 0, 255).astype(np.uint8)
        self._recent, self._known = self._mean, (mean[..., 0] >= 0).view(np.uint8) * np.uint8(255)
        self._anchor, self._stamp_s, self.is_known = view, stamp_s, True

    def invalidate(self) -> None:
        """Reset the model."""
        self.is_known = False

    def update(self, image: Image, view: View, stamp_s: float, object_px: BoxPx | None) -> None:
        """Update the model with an image, except around the tracked object's box."""
        if not self.is_known or stamp_s - self._stamp_s > _PERIOD_S - 1e-6:
            self._take(image, view, stamp_s, object_px, None)

    def set_from(self, image: Image, view: View, stamp_s: float, mask: Mask, box: Box) -> None:
        """Set the background of a mask (h, w) of the region `box` from the image."""
        self._take(image, view, stamp_s, None, (mask, box))

    def _take(
        self, image: Image, view: View, stamp_s: float, object_px: BoxPx | None, empty: tuple[Mask, Box] | None
    ) -> None:
        """Make the pose of an image the anchor."""
        height, width = image.shape[:2]
        x, y, w, h = object_px or (0.0, 0.0, 0.0, 0.0)
        kept = np.s_[
            max(int(y - _KEPT * h), 0) : max(int(y + (1 + _KEPT) * h), 0),
            max(int(x - _KEPT * w), 0) : max(int(x + (1 + _KEPT) * w), 0),
        ]
        whole = (0, 0, width, height)
        now = smoothed(image, whole)
        if not self.is_known or stamp_s - self._stamp_s > 2 * _PERIOD_S:
            mean, known = now.copy(), np.full((height, width), 255, np.uint8)
            known[kept] = 0
        else:
            mean, known = self._renewed(image, now, view, kept, empty)
        self._mean, self._recent, self._known = mean, now, known
        self._anchor, self._stamp_s, self.is_known = view, stamp_s, True

    def _renewed(
        self, image: Image, now: Pixels, view: View, kept: tuple[slice, slice], empty: tuple[Mask, Box] | None
    ) -> tuple[Pixels, NDArray[np.uint8]]:
        """Background warped to a view and updated with its image; and a mask, 255 where it is known."""
        whole = (0, 0, now.shape[1], now.shape[0])
        self._fit_distance(now, view)
        mean = self._warped(self._mean, view, whole)
        difference = np.abs(now[::_STEP, ::_STEP].astype(np.int16) - mean[::_STEP, ::_STEP])
        noise = 1.4826 * float(np.median(difference))  # standard deviation, from the absolute deviation
        self._threshold = min(max(_NOISE_FACTOR * noise, _MIN_CONTRAST), _MAX_CONTRAST)
        over, was_known = self._beyond(now, self._mean, view, whole, mean)
        moved = (was_known & (over > self._threshold)).view(np.uint8)
        moved[kept] = 0
        x, y, w, h = cv2.boundingRect(moved)
        if w:
            inside = np.s_[y : y + h, x : x + w]
            again, _ = self._beyond(now[inside], self._recent, view, (x, y, x + w, y + h))
            moved[inside][again <= self._threshold] = 0
            _drop_empty_places(image, mean, moved)
        if empty is not None:
            mask, (x0, y0, x1, y1) = empty
            moved[y0:y1, x0:x1][mask] = 0
        moved[kept] = 1
        cv2.copyTo(now, 1 - moved, mean)
        was_known[kept] &= mean[kept].any(axis=2)
        return mean, np.asarray((was_known | (moved == 0)).view(np.uint8) * np.uint8(255), np.uint8)

    def _fit_distance(self, now: Pixels, view: View) -> None:
        """Set the distance at which the anchor's image fits best, if it fits better than at the current one."""
        rows, columns = np.mgrid[_STEP // 2 : now.shape[0] : _STEP, _STEP // 2 : now.shape[1] : _STEP].reshape(2, -1)
        rays = view.rays(np.stack([columns, rows], axis=-1).astype(float))
        colors = now[rows, columns].astype(np.float32)
        differences = [
            color_difference(colors, view.center + rays / max(nearness, 1e-3), self._recent, self._anchor)
            for nearness in (self._nearness, *_NEARNESS)
        ]
        best = int(np.argmin(differences))
        if differences[best] < _MUCH_BETTER * differences[0]:
            self._nearness = float(_NEARNESS[best - 1])

    def _differs(self, now: Pixels, view: View, box: Box) -> Mask:
        over, known = self._beyond(now, self._mean, view, box)
        different: Mask = (over > self._threshold) | ~known
        return different

    def _beyond(
        self, now: Pixels, then: Pixels, view: View, box: Box, seen: Pixels | None = None
    ) -> tuple[NDArray[np.uint8], Mask]:
        """Largest difference (h, w) of the three channels of the pixels `now` of a box to the range of `then` within
        the tolerance, grey levels; and where it is known.

        Gaps that the tolerance leaves along edges of `then` are closed.  `seen` is the warped box, if already computed.
        """
        if not self.is_known:
            return np.zeros(now.shape[:2], np.uint8), np.zeros(now.shape[:2], bool)
        spread_px = _ROOM_STD * self._ego.parallax_px_m(self._anchor, view)
        m = min(_LEAST_PX + int(np.ceil(spread_px)), _MOST_PX)
        x0, y0, x1, y1 = box
        height, width = then.shape[:2]
        left, top = min(m, x0), min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, width), min(y1 + m, height)
        seen, kernel = self._warped(then, view, wide) if seen is None else seen, masks.square(m)
        known = cv2.erode(self._warped(self._known, view, wide), kernel) == 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        low, high = cv2.erode(seen, kernel)[inside], cv2.dilate(seen, kernel)[inside]
        over = cv2.morphologyEx(beyond(now, low, high), cv2.MORPH_CLOSE, masks.square(m + 1))
        return np.asarray(over, np.uint8), np.asarray(known[inside], bool)

    def _warped(self, image: NDArray[np.uint8], view: View, box: Box) -> NDArray[np.uint8]:
        """Box of an image of the anchor, warped to a view."""
        return self._ego.warp(image, self._anchor, view, self._nearness, box)


def _drop_empty_places(image: Image, mean: Pixels, moved: NDArray[np.uint8]) -> None:
    """Clear ghosts from the foreground `moved`."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(moved)
    for k in range(1, count):
        x, y, w, h, area = (int(value) for value in stats[k])
        if area >= MIN_GHOST_PX:
            mask = np.asarray(labels[y : y + h, x : x + w] == k)
            edge = edge_of_background(image, mean, 1.0, mask, (x, y, x + w, y + h))
            if edge is not None and edge > GHOST_EDGE:
                moved[y : y + h, x : x + w][mask] = 0


def beyond(now: Pixels, low: NDArray[Any], high: NDArray[Any]) -> NDArray[np.uint8]:
    """Largest difference (h, w) of the three channels below `low` or above `high`, grey levels."""
    return most(cv2.max(cv2.subtract(now, high), cv2.subtract(low, now)))


def most(levels: NDArray[Any]) -> NDArray[np.uint8]:
    """Largest of the three channels (h, w)."""
    red, green, blue = cv2.split(levels)
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)


def smoothed(image: Image, box: Box) -> Pixels:
    """Box (h, w, 3) of an image, smoothed over 3×3 px."""
    x0, y0, x1, y1 = box
    left, top, right, bottom = max(x0 - 1, 0), max(y0 - 1, 0), min(x1 + 1, image.shape[1]), min(y1 + 1, len(image))
    smooth = np.asarray(cv2.blur(image[top:bottom, left:right], (3, 3)), np.uint8)
    return np.ascontiguousarray(smooth[y0 - top : y1 - top, x0 - left : x1 - left])
