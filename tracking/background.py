"""Background model of a static camera: the mean image without moving objects."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.jit import njit
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.ego_motion import Box, EgoMotion
from tracking.moving_background import ASIDE_PX, BoxPx, MovingBackground, beyond, edge_of_background, most, smoothed

CHANGED = 0.3  # least foreground share of an object's image
_PERIOD_S = 0.2  # in which every row is updated once
_RATE = 0.1  # update rate of the running mean
_NOISE_FACTOR = 5.0  # foreground threshold: standard deviations
_MIN_CONTRAST = 3.5  # its minimum, grey levels
_SAMPLES = 20  # samples per row and column for gain and noise
_NEIGHBOURS = np.ones((3, 3), np.uint8)
_LIT = 20.0  # grey levels: darker pixels do not determine the gain
_UNKNOWN = -np.inf  # mean of a pixel that has always been hidden

Pixels = NDArray[np.float32]  # (h, w, 3)


class Background:
    """Mean colours of one camera's images, smoothed over 3×3 px.

    A pixel whose colour has been constant for `memory_s` becomes background, except near the tracked object.  The model
    is reset when the camera has moved and rests again; `moving` is the model of the moving camera.
    """

    def __init__(self, ego: EgoMotion, memory_s: float) -> None:
        self.ego = ego
        self.memory_s = memory_s
        self.moving = MovingBackground(ego)
        self._view: View | None = None
        self._last: View | None = None
        self._mean: Pixels
        self._recent: Image
        self._since_s: NDArray[np.float64]  # since when the pixel has its current colour
        self._measured: Image | None = None
        self._gain_and_noise: tuple[float, float]
        self._threshold = _MIN_CONTRAST
        self._row = 0  # next row to update
        self._learned_s = 0.0  # stamp of the last update

    def is_known(self, view: View) -> bool:
        """Whether the background is known for this pose of the camera."""
        return self._view is not None and self.ego.is_still(self._view, view)

    def behind_moving_eye(self, view: View, stamp_s: float) -> MovingBackground | None:
        """The background of the moving camera, initialized from the static one; None where it is unknown."""
        if self._view is not None and not self.is_known(view):
            self.moving.start(self._mean, self._view, stamp_s)
            self._view = None
        return self.moving if self.moving.is_known else None

    def evidence(self, image: Image, view: View, box: Box) -> NDArray[np.float32]:
        """Probability (h, w) that a pixel of a box is foreground: ½ at the threshold, 0 below half of it and where the
        background is unknown."""
        if not self.is_known(view):
            return np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
        share = np.arange(256, dtype=np.float32) / np.float32(2 * self._threshold)
        share[share <= 0.25] = 0
        return np.take(np.minimum(share, 1), self._difference(image, box))

    def differs(self, image: Image, view: View, box: Box) -> Mask:
        """Foreground mask (h, w) of a box; all pixels where the background is unknown."""
        if not self.is_known(view):
            return np.ones((box[3] - box[1], box[2] - box[0]), bool)
        different: Mask = self._difference(image, box) > int(self._threshold)
        return different

    def _difference(self, image: Image, box: Box) -> NDArray[np.uint8]:
        """Largest difference (h, w) of the three channels to the range of the background's 3×3 neighbourhood, grey
        levels; 255 at and beside unknown pixels, unless the pixel itself equals its background."""
        x0, y0, x1, y1 = box
        left = max(x0 - 1, 0)
        top = max(y0 - 1, 0)
        around = self._mean[top : y1 + 1, left : x1 + 1]
        inside = np.s_[y0 - top : y1 - top, x0 - left : x1 - left]
        expected = cv2.convertScaleAbs(around, alpha=self._gain_of(image))
        current = smoothed(image, box)
        over = beyond(current, cv2.erode(expected, _NEIGHBOURS)[inside], cv2.dilate(expected, _NEIGHBOURS)[inside])
        unknown = around[:, :, 0] < 0
        if unknown.any():
            beside = masks.dilated(unknown, 1)[inside]
            over[beside & (unknown[inside] | (most(cv2.absdiff(current, expected[inside])) > self._threshold))] = 255
        return over

    def has_changed(self, image: Image, view: View, x: int, y: int, w: int, h: int) -> bool:
        """Whether a box (px) is foreground, or the background is unknown."""
        return float(self.differs(image, view, (x, y, x + w, y + h)).mean()) > CHANGED

    def learned_edge(self, image: Image, view: View, mask: Mask, box: Box) -> float | None:
        """`edge_of_background` of a mask (h, w) of the region `box`; None where the background is unknown."""
        if self.is_known(view):
            return edge_of_background(image, self._mean, self._gain_of(image), mask, box)
        if not self.moving.is_known:
            return None
        m = int(2 * ASIDE_PX) + 1
        wide = masks.clipped((box[0] - m, box[1] - m, box[2] + m, box[3] + m), image.shape[1], len(image))
        left, top, right, bottom = wide
        inside = box[0] - left, box[1] - top, box[2] - left, box[3] - top
        return edge_of_background(image[top:bottom, left:right], self.moving.seen(view, wide), 1.0, mask, inside)

    def update(self, image: Image, view: View, stamp_s: float, objects_px: Sequence[BoxPx] = ()) -> None:
        """Update the model with an image, except around the boxes (x, y, width, height px) of the tracked objects."""
        last = self._last or view
        self._last = view
        if not self.is_known(view):
            self._view = view if self.ego.is_still(last, view) else None
            if self._view is not None:
                self._recent = smoothed(image, (0, 0, image.shape[1], len(image)))
                self._mean = self._recent.astype(np.float32)
                self._since_s = np.full(image.shape[:2], stamp_s)
                for x, y, w, h in objects_px:
                    box = max(int(x), 0), max(int(y), 0), max(int(x + w), 0), max(int(y + h), 0)
                    self._mean[box[1] : box[3], box[0] : box[2]] = self._behind(view, box, image)
                self.moving.invalidate()
            else:
                self.moving.update(image, view, stamp_s, objects_px)
            return
        height = len(image)
        top = self._row
        bottom = min(top + math.ceil(height * (stamp_s - self._learned_s) / _PERIOD_S), height)
        self._row = bottom % height
        self._learned_s = stamp_s
        gain, noise = self._gain_and_noise_of(image)
        rows = np.s_[top:bottom]
        self._threshold = max(_NOISE_FACTOR * 1.4826 * noise, _MIN_CONTRAST)
        current = smoothed(image, (0, top, image.shape[1], bottom))
        sides = ((x - 0.3 * w, y - 0.3 * h - top, x + 1.3 * w, y + 1.3 * h - top) for x, y, w, h in objects_px)
        excluded = np.array([*sides], int).reshape(-1, 4)
        layers = self._mean[rows], self._recent[rows], self._since_s[rows]
        _learn(current, *layers, gain, self._threshold, stamp_s, self.memory_s, excluded)

    def _behind(self, view: View, box: Box, image: Image) -> Pixels | float:
        """The moving camera's background of a box that an object hides."""
        box = box[0], box[1], min(box[2], image.shape[1]), min(box[3], image.shape[0])
        if not self.moving.is_known or box[0] >= box[2] or box[1] >= box[3]:
            return _UNKNOWN
        expected = self.moving.seen(view, box)
        expected[expected < 0] = _UNKNOWN
        return expected

    def invalidate(self, image: Image, view: View, mask: Mask, box: Box) -> None:
        """Mark the background as unknown where an object, a mask (h, w) of the region `box`, equals it, and in other
        foreground: the object may have been at rest there during learning."""
        if self.is_known(view):
            doubtful = self.differs(image, view, box) ^ mask
            self._mean[box[1] : box[3], box[0] : box[2]][doubtful] = _UNKNOWN

    def invalidate_box(self, image: Image, view: View, box_px: tuple[float, float, float, float]) -> None:
        """Mark the background as unknown behind an object's box (x, y, width, height px) and in the foreground within
        two box sizes: the object may have been at rest there during learning."""
        if not self.is_known(view):
            return
        x, y, w, h = (max(round(value), 0) for value in box_px)
        box = max(x - 2 * w, 0), max(y - 2 * h, 0), min(x + 3 * w, image.shape[1]), min(y + 3 * h, image.shape[0])
        doubtful = self.differs(image, view, box)
        doubtful[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = True
        self._mean[box[1] : box[3], box[0] : box[2]][doubtful] = _UNKNOWN

    def _gain_of(self, image: Image) -> float:
        """Brightness of an image relative to the background."""
        return self._gain_and_noise_of(image)[0]

    def _gain_and_noise_of(self, image: Image) -> tuple[float, float]:
        """`_gain_and_noise`, computed once per image."""
        if image is not self._measured:
            self._measured = image
            self._gain_and_noise = _gain_and_noise(image, self._mean)
        return self._gain_and_noise


@njit(cache=True, error_model="numpy")
def _gain_and_noise(image: Image, mean: Pixels) -> tuple[float, float]:
    """Gain of an image (h, w, 3) relative to a background (h, w, 3; median over lit pixels), and the median absolute
    difference of the smoothed image from the background times the gain."""
    levels = np.zeros(3 * _SAMPLES**2)
    expected = np.empty(3 * _SAMPLES**2)
    height = image.shape[0] - 2
    width = image.shape[1] - 2
    n = 0
    for i in range(_SAMPLES):
        y = (2 * i + 1) * height // (2 * _SAMPLES) + 1
        for j in range(_SAMPLES):
            x = (2 * j + 1) * width // (2 * _SAMPLES) + 1
            for channel in range(3):
                if mean[y, x, channel] >= 0:
                    for k in range(9):
                        levels[n] += image[y + k // 3 - 1, x + k % 3 - 1, channel]
                    expected[n] = mean[y, x, channel]
                    n += 1
    levels = levels[:n] / 9
    expected = expected[:n]
    lit = expected > _LIT
    gain = np.median(levels[lit] / expected[lit]) if lit.any() else 1.0
    return gain, np.median(np.abs(levels - gain * expected)) if n else 0.0


@njit(cache=True, error_model="numpy")
def _learn(
    current: NDArray[np.uint8],
    mean: Pixels,
    recent: NDArray[np.uint8],
    since_s: NDArray[np.float64],
    gain: float,
    threshold: float,
    stamp_s: float,
    memory_s: float,
    excluded: NDArray[np.int64],
) -> None:
    """Update `mean`, `recent` (h, w, 3) and `since_s` (h, w) with the rows `current`; not the mean in the
    boxes `excluded` (k, 4)."""
    rows, columns = since_s.shape
    scale, rate, limit = np.float32(1 / gain), np.float32(_RATE), np.float32(threshold)
    half, brightest = np.float32(0.5), np.float32(255)
    for y in range(rows):
        for x in range(columns):
            red, green, blue = (
                min(scale * current[y, x, 0], brightest),
                min(scale * current[y, x, 1], brightest),
                min(scale * current[y, x, 2], brightest),
            )
            r, g, b = mean[y, x, 0], mean[y, x, 1], mean[y, x, 2]
            if max(abs(red - recent[y, x, 0]), abs(green - recent[y, x, 1]), abs(blue - recent[y, x, 2])) > limit:
                recent[y, x, 0], recent[y, x, 1], recent[y, x, 2] = red + half, green + half, blue + half
                since_s[y, x] = stamp_s
            is_excluded = False
            for k in range(len(excluded)):
                if excluded[k, 0] <= x < excluded[k, 2] and excluded[k, 1] <= y < excluded[k, 3]:
                    is_excluded = True
            if is_excluded:
                continue
            if max(abs(red - r), abs(green - g), abs(blue - b)) <= limit:
                mean[y, x, 0], mean[y, x, 1] = r + rate * (red - r), g + rate * (green - g)
                mean[y, x, 2] = b + rate * (blue - b)
            elif stamp_s - since_s[y, x] > memory_s:
                mean[y, x, 0], mean[y, x, 1], mean[y, x, 2] = red, green, blue
