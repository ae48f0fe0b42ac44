"""Tells a foreground object from a ghost (the uncovered place of an object that was learned as background)."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Image, Mask
from tracking.ego_motion import Box

# On independent films of seeds 4105 and 4111 `learned_edge` is 0.76-0.96 for ghosts of a red ball and 0.62-0.77 for
# ghosts of a grey one; for the balls themselves 0.2-0.4 (median), above 0.77 in 5 % of the frames of a grey one.
LEARNED_EDGE = 0.6  # above it a region is rather a ghost
_GHOST_EDGE = 0.7  # the same where no object is tracked
_MIN_GHOST_PX = 64  # area of a ghost where no object is tracked
ASIDE_PX = 2.5  # distance to both sides of the edge at which colours are compared
_TANGENT = 4  # edge points to both sides that give the direction
_MIN_EDGE_POINTS = 30  # with known background
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


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
    left = min(u.min(), x.min()) - 1
    top = min(v.min(), y.min()) - 1
    right = max(u.max(), x.max()) + 2
    bottom = max(v.max(), y.max()) + 2
    smooth = cv2.blur(image[top:bottom, left:right], (3, 3)).astype(np.float32)
    image_step = np.abs(smooth[v - top, u - left] - smooth[y - top, x - left]).max(axis=1)
    background_step = np.abs(mean[v, u].astype(np.float32) - mean[y, x]).max(axis=1)
    return float(np.mean(gain * background_step > image_step))


def ghosts(
    foreground: NDArray[np.uint8], image: Image, mean: NDArray[Any], gain: float, margin: int = 0
) -> Iterator[tuple[Mask, Box]]:
    """Yield the ghosts among the components of a foreground (H, W): mask (h, w) and box, with a margin in px.

    Image, background and gain as for `edge_of_background`.
    """
    left, top, width, height = cv2.boundingRect(foreground)
    if not width:
        return
    part = foreground[top : top + height, left : left + width]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(part)
    for k in range(1, count):
        x, y, w, h, area = (int(value) for value in stats[k])
        if area < _MIN_GHOST_PX:
            continue
        x += left - margin
        y += top - margin
        box = (max(x, 0), max(y, 0), min(x + w + 2 * margin, image.shape[1]), min(y + h + 2 * margin, len(image)))
        mask = np.pad(np.asarray(labels[y + margin - top :, x + margin - left :][:h, :w] == k), margin)
        mask = mask[box[1] - y : box[3] - y, box[0] - x : box[2] - x]
        edge = edge_of_background(image, mean, gain, mask, box)
        if edge is not None and edge > _GHOST_EDGE:
            yield mask, box
