"""The cheaper road for a marker of known hue: threshold, blob, sub-pixel outline; no particles."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array, Image, Mask
from tracking.compiled import Hues, marker
from tracking.ego_motion import Box
from tracking.outline import Coverage, Optics, Outline, outline_of
from tracking.rim import see

CLEAR = 3  # px around a marker that must be clear, so that nothing of it lies beyond
_PAD = 8  # px

Found = list[Outline] | None
"""What an image shows of what is looked for, at most one outline; None where that is not known."""


@dataclass(frozen=True)
class MarkerParams:
    """`hue_deg` of the marker and how far it may be off; the least saturation and value (0–1) at
    which a hue counts; `reach` of a tracked marker's size that is searched around it; the smallest
    blob, and how many of them are looked at."""

    hue_deg: float = 120.0
    hue_tolerance_deg: float = 35.0
    min_saturation: float = 0.5
    min_value: float = 0.12
    min_area_px: int = 8
    reach: float = 1.0
    max_blobs: int = 4

    @cached_property
    def ranges(self) -> list[tuple[Array, Array]]:
        """Lowest and highest hue (0–180), saturation and value (0–255), as OpenCV counts them: one range, or two
        where it crosses 0°."""
        low, high = (self.hue_deg - self.hue_tolerance_deg) / 2, (self.hue_deg + self.hue_tolerance_deg) / 2
        floor = 255 * self.min_saturation, 255 * self.min_value
        shifts = [shift for shift in (-180.0, 0.0, 180.0) if low + shift <= 180 and high + shift >= 0]
        return [(np.array([low + shift, *floor]), np.array([high + shift, 255.0, 255.0])) for shift in shifts]

    @cached_property
    def hues(self) -> Hues:
        """The same for compiled code."""
        (low, high), *across = self.ranges
        if across:
            low, high = across[0][0], self.ranges[0][1]
        return Hues(round(low[0]), round(high[0]), round(low[1]), round(low[2]), self.min_area_px)

    def __post_init__(self) -> None:
        if not (0 <= self.hue_deg < 360 and 0 < self.hue_tolerance_deg <= 90 and self.min_area_px >= 1):
            raise ValueError(
                f"marker hue {self.hue_deg}° ± {self.hue_tolerance_deg}°, area {self.min_area_px}: "
                "expected a hue in [0, 360), a tolerance in (0, 90] and an area of at least 1"
            )


def find_markers(
    params: MarkerParams,
    image: Image,
    optics: Optics,
    near: tuple[float, float, float] | None = None,
    expected_area_px: float | None = None,
) -> list[Outline]:
    """The blobs of the marker's hue in an RGB image, the largest and roundest first.

    `near` (x, y, half side px) is where to look instead of everywhere; what is smaller than its expected area is
    taken for partly hidden (`rim.see`).
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = 0, 0, width, height
    if near is not None:
        x, y, half = near
        x0, y0 = max(int(x - half), 0), max(int(y - half), 0)
        x1, y1 = min(int(x + half) + 2, width), min(int(y + half) + 2, height)
        if x1 - x0 < 3 or y1 - y0 < 3:
            return []
    hard = threshold(params, image[y0:y1, x0:x1])
    contours, _ = cv2.findContours(hard, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = sorted((blob_of(contour) for contour in contours), key=lambda blob: -blob.worth)
    found = []
    for blob in [blob for blob in blobs if blob.area_px >= params.min_area_px][: params.max_blobs]:
        mask, box = cut_out(blob, (x0, y0), (x0, y0, x1, y1))
        shape = see(image, mask, box, optics, expected_area_px, notched=False)
        found += [shape] if shape else []
    return found


def find_clear(params: MarkerParams, image: Image, optics: Optics, at: Array, half: float) -> Outline | None:
    """The only blob of the marker's hue within `half` px of a pixel (2,), if all around it is clear; else None."""
    (x, y), (height, width) = at.tolist(), image.shape[:2]
    left, top, side = int(x - half), int(y - half), 2 * int(half) + 2
    around = max(top, 0), min(top + side, height), max(left, 0), min(left + side, width)
    if around[1] - around[0] < 3 or around[3] - around[2] < 3:
        return None
    found, alpha, variance, (y0, y1, x0, x1), seen = marker(image, params.hues, around, CLEAR, _PAD, optics.weights)
    return outline_of(seen, Coverage(alpha, variance, (x0, y0, x1, y1)), optics) if found else None


class _Blob(NamedTuple):
    """What a contour encloses: area px, box x, y, width, height, and how much it is worth a look."""

    contour: NDArray[Any]
    box: tuple[int, int, int, int]
    area_px: float
    worth: float


def blob_of(contour: NDArray[Any]) -> _Blob:
    x, y, w, h = cv2.boundingRect(contour)
    area = cv2.contourArea(contour) + 0.5 * len(contour) + 1  # by Pick's theorem: the contour's own pixels too
    roundness = area / (math.pi / 4 * max(w, h) ** 2)  # of its surrounding circle
    return _Blob(contour, (x, y, w, h), area, area * min(roundness, 1.0) ** 2)


def cut_out(blob: _Blob, corner: tuple[int, int], within: Box) -> tuple[Mask, Box]:
    """The mask of a blob, its holes filled, in what of an image begins at that corner, and its box in the image: with
    room around, as far as it is `within`, for the outline's idea of the background."""
    (x, y, w, h), (x0, y0) = blob.box, corner
    left, top = max(x0 + x - _PAD, within[0]), max(y0 + y - _PAD, within[1])
    right, bottom = min(x0 + x + w + _PAD, within[2]), min(y0 + y + h + _PAD, within[3])
    mask = np.zeros((bottom - top, right - left), np.uint8)
    cv2.drawContours(mask, [blob.contour], 0, (1,), cv2.FILLED, offset=(x0 - left, y0 - top))
    return mask.view(bool), (left, top, right, bottom)


def threshold(params: MarkerParams, image: Image) -> NDArray[np.uint8]:
    """255 where the hue is the marker's; a range of hues that crosses 0° is taken in two parts."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    parts = [np.asarray(cv2.inRange(hsv, low, high), dtype=np.uint8) for low, high in params.ranges]
    return parts[0] if len(parts) == 1 else parts[0] | parts[1]
