"""Background model of a moving camera: an earlier image warped to the current pose."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.ego_motion import ROOM_M, Box, EgoMotion, color_difference

# On independent films of seeds 4105 and 4111 `learned_edge` is 0.76-0.96 for ghosts of a red ball and 0.62-0.77 for
# ghosts of a grey one; for the balls themselves 0.2-0.4 (median), above 0.77 in 5 % of the frames of a grey one.
LEARNED_EDGE = 0.6  # above it a region is rather a ghost
ASIDE_PX = 2.5  # distance to both sides of the edge at which colours are compared
_TANGENT = 4  # edge points to both sides that give the direction
_MIN_EDGE_POINTS = 30  # with known background
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
# Chosen on independent films of seeds 7000-7005 (a grey ball before moving eyes).
_PERIOD_S = 0.5  # age of the anchor; a pixel equal in images that far apart is background
_ROOM_STD = 0.1  # 1/m by which most static things differ from the fitted distance, `ROOM_M` at first
_NEARNESS = np.linspace(0, 2, 11)  # 1/m: candidates for the inverse distance
_MUCH_BETTER = 0.95  # difference relative to the current distance's below which another one replaces it
_LEAST_PX = 1  # tolerated error of the pose and of the distance
_MOST_PX = 3
_NOISE_FACTOR = 5.0  # foreground threshold: standard deviations, as `TriggerParams`
_MIN_CONTRAST = 6.0  # grey levels
_MAX_CONTRAST = 15.0
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
        self.is_known = False  # whether anything was learned; the attributes below are invalid until it is
        self._ego = ego
        self._anchor = View(ego.camera, np.eye(4))
        self._stamp_s = 0.0
        self._mean = self._recent = np.empty((0, 0, 3), np.uint8)
        self._known = np.empty((0, 0), np.uint8)  # 255 where the mean is known
        self._threshold = _MIN_CONTRAST
        self._nearness = 1 / ROOM_M

    def evidence(self, image: Image, view: View, box: Box) -> NDArray[np.float32]:
        """Probability (h, w) that a pixel of a box is foreground, as `Background.evidence`; 0 where unknown."""
        over, is_known = self._beyond(smoothed(image, box), self._mean, view, box)
        share = np.minimum(over * np.float32(0.5 / self._threshold), 1)
        return np.asarray(np.where(is_known & (share > 0.25), share, 0), np.float32)

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
        levels = np.clip(np.rint(mean), 0, 255).astype(np.uint8)
        known_mask = (mean[..., 0] >= 0).view(np.uint8) * np.uint8(255)
        self._set_anchor(levels, levels, known_mask, view, stamp_s)

    def invalidate(self) -> None:
        """Reset the model."""
        self.is_known = False

    def update(self, image: Image, view: View, stamp_s: float, objects_px: Sequence[BoxPx] = ()) -> None:
        """Make the pose of an image the anchor, every `_PERIOD_S`; the boxes of the tracked objects are left out."""
        if self.is_known and stamp_s - self._stamp_s <= _PERIOD_S - 1e-6:
            return
        height, width = image.shape[:2]
        excluded = np.zeros((height, width), bool)
        for x, y, w, h in objects_px:
            excluded[
                max(int(y - _KEPT * h), 0) : max(int(y + (1 + _KEPT) * h), 0),
                max(int(x - _KEPT * w), 0) : max(int(x + (1 + _KEPT) * w), 0),
            ] = True
        whole = (0, 0, width, height)
        current = smoothed(image, whole)
        if not self.is_known or stamp_s - self._stamp_s > 2 * _PERIOD_S:
            mean = current.copy()
            known_mask = np.full((height, width), 255, np.uint8)
            known_mask[excluded] = 0
        else:
            mean, known_mask = self._renewed(image, current, view, excluded)
        self._set_anchor(mean, current, known_mask, view, stamp_s)

    def _set_anchor(
        self, mean: Pixels, current: Pixels, known_mask: NDArray[np.uint8], view: View, stamp_s: float
    ) -> None:
        self._mean = mean
        self._recent = current
        self._known = known_mask
        self._anchor = view
        self._stamp_s = stamp_s
        self.is_known = True

    def _renewed(self, image: Image, current: Pixels, view: View, excluded: Mask) -> tuple[Pixels, NDArray[np.uint8]]:
        """Background warped to a view and updated with its image; and a mask, 255 where it is known."""
        whole = (0, 0, current.shape[1], current.shape[0])
        self._fit_distance(current, view)
        mean = self._warped(self._mean, view, whole)
        difference = np.abs(current[::_STEP, ::_STEP].astype(np.int16) - mean[::_STEP, ::_STEP])
        noise = 1.4826 * float(np.median(difference))  # standard deviation, from the absolute deviation
        self._threshold = min(max(_NOISE_FACTOR * noise, _MIN_CONTRAST), _MAX_CONTRAST)
        over, was_known = self._beyond(current, self._mean, view, whole, mean)
        moved = (was_known & (over > self._threshold)).view(np.uint8)
        moved[excluded] = 0
        x, y, w, h = cv2.boundingRect(moved)
        if w:
            inside = np.s_[y : y + h, x : x + w]
            changed_since, _ = self._beyond(current[inside], self._recent, view, (x, y, x + w, y + h))
            moved[inside][changed_since <= self._threshold] = 0
        moved[excluded] = 1
        cv2.copyTo(current, 1 - moved, mean)
        was_known[excluded] &= mean[excluded].any(axis=1)
        return mean, np.asarray((was_known | (moved == 0)).view(np.uint8) * np.uint8(255), np.uint8)

    def _fit_distance(self, current: Pixels, view: View) -> None:
        """Set the distance at which the anchor's image fits best, if it fits better than at the current one."""
        rows, columns = np.mgrid[_STEP // 2 : current.shape[0] : _STEP, _STEP // 2 : current.shape[1] : _STEP].reshape(
            2, -1
        )
        rays = view.rays(np.stack([columns, rows], axis=-1).astype(float))
        colors = current[rows, columns].astype(np.float32)
        differences = [
            color_difference(colors, view.center + rays / max(nearness, 1e-3), self._recent, self._anchor)
            for nearness in (self._nearness, *_NEARNESS)
        ]
        best = int(np.argmin(differences))
        if differences[best] < _MUCH_BETTER * differences[0]:
            self._nearness = float(_NEARNESS[best - 1])

    def _differs(self, current: Pixels, view: View, box: Box) -> Mask:
        over, is_known = self._beyond(current, self._mean, view, box)
        different: Mask = (over > self._threshold) | ~is_known
        return different

    def _beyond(
        self, current: Pixels, reference: Pixels, view: View, box: Box, warped: Pixels | None = None
    ) -> tuple[NDArray[np.uint8], Mask]:
        """Largest difference (h, w) of the three channels of a box (its pixels `current`) to the range of `reference`
        within the tolerance, grey levels; and a mask of its known pixels.

        Gaps that the tolerance leaves along edges are closed.  `warped` is the warped box, if already computed.
        """
        if not self.is_known:
            return np.zeros(current.shape[:2], np.uint8), np.zeros(current.shape[:2], bool)
        spread_px = _ROOM_STD * self._ego.parallax_px_m(self._anchor, view)
        m = min(_LEAST_PX + int(np.ceil(spread_px)), _MOST_PX)
        x0, y0, x1, y1 = box
        height, width = reference.shape[:2]
        left = min(m, x0)
        top = min(m, y0)
        wide = x0 - left, y0 - top, min(x1 + m, width), min(y1 + m, height)
        if warped is None:
            warped = self._warped(reference, view, wide)
        kernel = masks.square(m)
        known_mask = cv2.erode(self._warped(self._known, view, wide), kernel) == 255
        inside = np.s_[top : top + y1 - y0, left : left + x1 - x0]
        over = beyond(current, cv2.erode(warped, kernel)[inside], cv2.dilate(warped, kernel)[inside])
        closed = cv2.morphologyEx(over, cv2.MORPH_CLOSE, masks.square(m + 1))
        return np.asarray(closed, np.uint8), np.asarray(known_mask[inside], bool)

    def _warped(self, image: NDArray[np.uint8], view: View, box: Box) -> NDArray[np.uint8]:
        """Box of an image of the anchor, warped to a view."""
        return self._ego.warp(image, self._anchor, view, self._nearness, box)


def beyond(current: Pixels, low: NDArray[Any], high: NDArray[Any]) -> NDArray[np.uint8]:
    """Largest difference (h, w) of the three channels below `low` or above `high`, grey levels."""
    return most(cv2.max(cv2.subtract(current, high), cv2.subtract(low, current)))


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


def edge_of_background(image: Image, mean: NDArray[Any], gain: float, mask: Mask, box: Box) -> float | None:
    """Share of a mask's edge across which the background changes more than the image: above ½ for a ghost, below for
    an object. None where too little of the background is known.

    Args:
        image: RGB (H, W, 3).
        mean: Background (H, W, 3), below 0 where it is unknown.
        gain: Brightness of the image relative to the background.
        mask: Mask (h, w) of the region `box`.
        box: Region of the image.
    """
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(contours, key=len)[:, 0].astype(float)
    along = np.roll(edge, -_TANGENT, axis=0) - np.roll(edge, _TANGENT, axis=0)
    length = np.hypot(*along.T)
    is_smooth = length > 1
    across = (along @ _QUARTER_TURN)[is_smooth] / length[is_smooth, None]
    edge = edge[is_smooth]
    height, width = image.shape[:2]
    sides = [np.rint(edge + box[:2] + sign * ASIDE_PX * across).astype(int) for sign in (1, -1)]
    inside = np.all([((q > 0) & (q < (width - 1, height - 1))).all(axis=1) for q in sides], axis=0)
    (u, v), (x, y) = (q[inside].T for q in sides)
    is_known = (mean[v, u, 0] >= 0) & (mean[y, x, 0] >= 0)
    if np.count_nonzero(is_known) < _MIN_EDGE_POINTS:
        return None
    u, v, x, y = (coordinate[is_known] for coordinate in (u, v, x, y))
    rows, columns = np.mgrid[-1:2, -1:2].reshape(2, -1, 1)  # smoothed over 3×3 px
    image_step = np.abs(image[v + rows, u + columns].mean(axis=0) - image[y + rows, x + columns].mean(axis=0)).max(
        axis=1
    )
    background_step = np.abs(mean[v, u].astype(np.float32) - mean[y, x]).max(axis=1)
    return float(np.mean(gain * background_step > image_step))
