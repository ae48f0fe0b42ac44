"""The cheaper road for a marker of known hue: threshold, blob, sub-pixel outline; no particles."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Image, Mask
from tracking.ego_motion import Box
from tracking.outline import Optics, Outline
from tracking.rim import see

_PAD = 8  # px


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

    def __post_init__(self) -> None:
        if not (0 <= self.hue_deg < 360 and 0 < self.hue_tolerance_deg <= 90 and self.min_area_px >= 1):
            raise ValueError(
                f"marker hue {self.hue_deg}° ± {self.hue_tolerance_deg}°, area {self.min_area_px}: "
                "expected a hue in [0, 360), a tolerance in (0, 90] and an area of at least 1"
            )


def find_markers(
    params: MarkerParams, image: Image, optics: Optics, near: tuple[float, float, float] | None = None
) -> list[Outline]:
    """The blobs of the marker's hue in an RGB image, the largest and roundest first.

    `near` (x, y, half side px) is where to look instead of everywhere.
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = 0, 0, width, height
    if near is not None:
        x, y, half = near
        x0, y0 = max(int(x - half), 0), max(int(y - half), 0)
        x1, y1 = min(int(x + half) + 2, width), min(int(y + half) + 2, height)
        if x1 - x0 < 3 or y1 - y0 < 3:
            return []
    hard = _threshold(params, np.ascontiguousarray(image[y0:y1, x0:x1]))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(hard, connectivity=4)
    side = np.maximum(stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT])
    area = stats[1:, cv2.CC_STAT_AREA]
    roundness = area / np.maximum(0.785 * side * side, 1)  # of its surrounding circle
    worth = np.where(area >= params.min_area_px, area * np.minimum(roundness, 1) ** 2, 0)
    found = []
    for k in np.argsort(-worth)[: params.max_blobs]:
        if worth[k] > 0:
            box, mask = _cut_out(np.asarray(labels), int(k) + 1, stats[k + 1])
            shape = see(image, mask, (x0 + box[0], y0 + box[1], x0 + box[2], y0 + box[3]), optics)
            found += [shape] if shape else []
    return found


def _cut_out(labels: NDArray[np.integer], label: int, stats: NDArray[np.integer]) -> tuple[Box, Mask]:
    """One blob's mask, with room around for the outline's idea of the background."""
    x, y, w, h = (int(value) for value in stats[:4])
    box = max(x - _PAD, 0), max(y - _PAD, 0), min(x + w + _PAD, labels.shape[1]), min(y + h + _PAD, labels.shape[0])
    return box, np.asarray(labels[box[1] : box[3], box[0] : box[2]] == label)


def _threshold(params: MarkerParams, image: Image) -> NDArray[np.uint8]:
    """255 where the hue is the marker's; a range of hues that crosses 0° is taken in two parts."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    low, high = (params.hue_deg - params.hue_tolerance_deg) / 2, (params.hue_deg + params.hue_tolerance_deg) / 2
    floor = (255 * params.min_saturation, 255 * params.min_value)
    hard = np.zeros(image.shape[:2], np.uint8)
    for shift in (-180.0, 0.0, 180.0):
        if low + shift <= 180 and high + shift >= 0:
            part = cv2.inRange(hsv, np.array([low + shift, *floor]), np.array([high + shift, 255, 255]))
            hard |= np.asarray(part, dtype=np.uint8)
    return hard
