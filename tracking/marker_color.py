"""The colour that a marker was last seen in: narrower than the hue it is known by, and not that of what is like it."""

from dataclasses import replace

import cv2
import numpy as np

from pps_vision.types import Image
from tracking.marker import MarkerParams

_HUE_MARGIN_DEG, _SATURATION_MARGIN = 10.0, 0.15
_MIDDLE = 0.7  # of its box: no pixel there mixes with the background


def middle_of(image: Image, box_px: tuple[float, float, float, float]) -> Image:
    """A copy of the middle of `box_px` (x, y, width, height): a camera's driver may fill the same image anew."""
    x, y, w, h = box_px
    cx, cy = x + 0.5 * (w - 1), y + 0.5 * (h - 1)
    half_w, half_h = max(0.35 * _MIDDLE * w, 1.0), max(0.35 * _MIDDLE * h, 1.0)
    rows = slice(max(round(cy - half_h), 0), round(cy + half_h) + 1)
    columns = slice(max(round(cx - half_w), 0), round(cx + half_w) + 1)
    return image[rows, columns].copy()


def narrowed(params: MarkerParams, middle: Image) -> MarkerParams:
    """`params` with the hue and the least saturation that the middle of a marker has; never wider than they were, and
    unchanged where too little of it has the hue."""
    hue, saturation = cv2.cvtColor(middle, cv2.COLOR_RGB2HSV).reshape(-1, 3)[:, :2].astype(float).T
    off_deg = (2 * hue - params.hue_deg + 180) % 360 - 180
    own = np.abs(off_deg) <= params.hue_tolerance_deg
    if np.count_nonzero(own) < 4:
        return params
    low, high = np.percentile(off_deg[own], (25, 75)) + np.array([-1, 1]) * _HUE_MARGIN_DEG
    low, high = max(low, -params.hue_tolerance_deg), min(high, params.hue_tolerance_deg)
    least = float(np.percentile(saturation[own], 25)) / 255 - _SATURATION_MARGIN
    return replace(
        params,
        hue_deg=float((params.hue_deg + 0.5 * (low + high)) % 360),
        hue_tolerance_deg=float(0.5 * (high - low)),
        min_saturation=max(params.min_saturation, least),
    )
