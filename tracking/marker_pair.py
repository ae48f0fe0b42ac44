"""A marker in both eyes at once, while it is where it should be and nothing is in its way."""

from typing import TypeVar

import cv2
import numpy as np

from pps_vision.types import Array, Image
from tracking.marker import MarkerParams, blob_of, cut_out, threshold
from tracking.outline import Optics, Outline, cover, outline

T = TypeVar("T")
Pair = tuple[T, T]  # left, right
CLEAR = 3  # px around a marker that must be clear, so that nothing of it lies beyond


def find_pair(
    params: MarkerParams, images: Pair[Image], optics: Pair[Optics], near: Pair[Array], half: float
) -> Pair[Outline | None] | None:
    """The marker in both eyes, if within `half` px of where `near` (2,) expects it there is one blob of its hue in
    each, with nothing of it at the border; else None, and each eye is to be searched by itself.

    Both windows are looked at as one picture: with so few pixels that takes as long for two eyes as for one.
    """
    side = 2 * int(half) + 2
    if side > min(*images[0].shape[:2], *images[1].shape[:2]):
        return None
    windows = np.empty((2, side, side, 3), np.uint8)
    corners = _corner(images[0], near[0], side), _corner(images[1], near[1], side)
    for window, image, (x0, y0) in zip(windows, images, corners, strict=True):
        window[:] = image[y0 : y0 + side, x0 : x0 + side]
    hard = threshold(params, windows.reshape(2 * side, side, 3))
    contours, _ = cv2.findContours(hard, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = [blob for blob in map(blob_of, contours) if blob.area_px >= params.min_area_px]
    if len(blobs) != 2:
        return None
    found = []
    for index, blob in enumerate(sorted(blobs, key=lambda blob: blob.box[1])):
        (x, y, w, h), top = blob.box, index * side
        if min(x, y - top) < CLEAR or max(x + w, y - top + h) > side - CLEAR:
            return None
        (x0, y0), image = corners[index], images[index]
        mask, box = cut_out(blob, (x0, y0 - top), (0, 0, image.shape[1], image.shape[0]))
        found.append(outline(cover(image, mask, box), optics[index]))
    return found[0], found[1]


def _corner(image: Image, at: Array, side: int) -> tuple[int, int]:
    """Of the square around a pixel (2,), moved where it would reach beyond the image."""
    x, y = at.tolist()
    x0, y0 = int(x) - side // 2 + 1, int(y) - side // 2 + 1
    return min(max(x0, 0), image.shape[1] - side), min(max(y0, 0), image.shape[0] - side)
