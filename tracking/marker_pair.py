"""A marker in both eyes at once, while it is where it should be and nothing is in its way."""

from typing import TypeVar

import cv2
import numpy as np

from pps_vision.types import Array, Image
from tracking.ego_motion import Box
from tracking.marker import MarkerParams, blob_of, threshold
from tracking.outline import CLEAR, ROOM, Optics, Outline, outline_pair

T = TypeVar("T")
Pair = tuple[T, T]  # left, right


def find_pair(
    params: MarkerParams, images: Pair[Image], optics: Pair[Optics], near: Pair[Array], half: float
) -> Pair[Outline | None] | None:
    """The marker in both eyes, if within `half` px of where `near` (2,) expects it there is one blob of its hue in
    each, with nothing of it at the border; else None, and each eye is to be searched by itself.

    Both windows are looked at as one picture: with so few pixels that takes as long for two eyes as for one.
    """
    side = 2 * int(half) + 2
    if side + 2 * ROOM > min(*images[0].shape[:2], *images[1].shape[:2]):
        return None
    boxes = _window(images[0], near[0], side), _window(images[1], near[1], side)
    patches = np.empty((2, side + 2 * ROOM, side + 2 * ROOM, 3), np.uint8)
    for patch, image, (x0, y0, x1, y1) in zip(patches, images, boxes, strict=True):
        patch[:] = image[y0 - ROOM : y1 + ROOM, x0 - ROOM : x1 + ROOM]
    middle = patches[:, ROOM:-ROOM, ROOM:-ROOM].reshape(2 * side, side, 3)
    contours, _ = cv2.findContours(threshold(params, middle), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = [blob for blob in map(blob_of, contours) if blob.area_px >= params.min_area_px]
    if len(blobs) != 2:
        return None
    for top, blob in zip((0, side), sorted(blobs, key=lambda blob: blob.box[1]), strict=True):
        x, y, w, h = blob.box
        if min(x, y - top) < CLEAR or max(x + w, y - top + h) > side - CLEAR:
            return None
    mask = np.zeros(middle.shape[:2], np.uint8)
    cv2.drawContours(mask, [blob.contour for blob in blobs], -1, (1,), cv2.FILLED)
    left, right = outline_pair(patches, mask.view(bool).reshape(2, side, side), boxes, optics)
    return left, right


def _window(image: Image, at: Array, side: int) -> Box:
    """The square around a pixel (2,), moved where it reaches so far that the image lacks `ROOM` around it."""
    x, y = at.tolist()
    x0 = min(max(int(x) - side // 2 + 1, ROOM), image.shape[1] - side - ROOM)
    y0 = min(max(int(y) - side // 2 + 1, ROOM), image.shape[0] - side - ROOM)
    return x0, y0, x0 + side, y0 + side
