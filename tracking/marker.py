"""The cheaper road for a marker of known hue: threshold, blob, sub-pixel outline; no particles."""

from dataclasses import dataclass

import cv2
import numpy as np

from pps_vision.types import Image
from tracking.outline import Optics, Outline, cover, outline


@dataclass(frozen=True)
class MarkerParams:
    """`hue_deg` of the marker and how far it may be off; the least saturation and value (0–1) at
    which a hue counts; the smallest blob; `reach` of a tracked marker's size that is searched."""

    hue_deg: float = 120.0
    hue_tolerance_deg: float = 35.0
    min_saturation: float = 0.35
    min_value: float = 0.12
    min_area_px: int = 8
    reach: float = 1.0

    def __post_init__(self) -> None:
        if not (0 <= self.hue_deg < 360 and 0 < self.hue_tolerance_deg <= 90 and self.min_area_px >= 1):
            raise ValueError(
                f"marker hue {self.hue_deg}° ± {self.hue_tolerance_deg}°, area {self.min_area_px}: "
                "expected a hue in [0, 360), a tolerance in (0, 90] and an area of at least 1"
            )


def find_marker(
    params: MarkerParams, image: Image, optics: Optics, near: tuple[float, float, float] | None = None
) -> Outline | None:
    """The largest blob of the marker's hue in an RGB image, or None.

    `near` (x, y, half side px) is where to look instead of everywhere.
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = 0, 0, width, height
    if near is not None:
        x, y, half = near
        x0, y0 = max(int(x - half), 0), max(int(y - half), 0)
        x1, y1 = min(int(x + half) + 2, width), min(int(y + half) + 2, height)
        if x1 - x0 < 3 or y1 - y0 < 3:
            return None
    hard = _threshold(params, np.ascontiguousarray(image[y0:y1, x0:x1]))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(hard, connectivity=4)
    if count < 2:
        return None
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    bx, by, bw, bh, area = (int(value) for value in stats[largest])
    if area < params.min_area_px:
        return None
    pad = 8  # room around the blob for the outline's idea of the background
    cx0, cy0, cx1, cy1 = max(bx - pad, 0), max(by - pad, 0), min(bx + bw + pad, x1 - x0), min(by + bh + pad, y1 - y0)
    mask = labels[cy0:cy1, cx0:cx1] == largest
    return outline(cover(image, mask, (x0 + cx0, y0 + cy0, x0 + cx1, y0 + cy1)), optics)


def _threshold(params: MarkerParams, image: Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    low, high = (params.hue_deg - params.hue_tolerance_deg) / 2, (params.hue_deg + params.hue_tolerance_deg) / 2
    floor = (255 * params.min_saturation, 255 * params.min_value)
    hard = cv2.inRange(hsv, np.array([max(low, 0), *floor]), np.array([min(high, 180), 255, 255]))
    if low < 0:
        hard |= cv2.inRange(hsv, np.array([180 + low, *floor]), np.array([180, 255, 255]))
    if high > 180:
        hard |= cv2.inRange(hsv, np.array([0, *floor]), np.array([high - 180, 255, 255]))
    return np.asarray(hard, dtype=np.uint8)
