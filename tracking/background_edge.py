"""Whether what differs from a background is an object before it, or the empty place of what was learned with it."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Image, Mask
from tracking.ego_motion import Box

# On independent films of seeds 4105 and 4111 `learned_edge` is 0.76-0.96 of places that a red ball has left, 0.62-0.77
# of those of a grey one; of the balls 0.2-0.4 in the median, of a grey one above 0.77 in 5 % of the frames.
LEARNED_EDGE = 0.6  # from which a place rather is empty
SURELY_EMPTY, LEAST_PLACE_PX = 0.7, 64  # the same where nothing is tracked; smallest such place
ASIDE_PX, _TANGENT = 2.5, 4  # an edge is compared so far to both sides; neighbours that give its direction
_LEAST_EDGE = 30  # of its points, which must be known
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def edge_of_background(image: Image, mean: NDArray[Any], gain: float, mask: Mask, box: Box) -> float | None:
    """Share of the edge of a mask (h, w) of the region `box` across which the background changes more than the image.

    Above ½ for the empty place of what was learned as background, below for an object before it; None where too little
    of the background is known.  `mean` (H, W, 3) is the background, below 0 where it is unknown; `gain` times as bright
    is the image.
    """
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(contours, key=len)[:, 0].astype(float)
    along = np.roll(edge, -_TANGENT, axis=0) - np.roll(edge, _TANGENT, axis=0)
    length = np.hypot(*along.T)
    edge, across = edge[length > 1], (along @ _QUARTER_TURN)[length > 1] / length[length > 1, None]
    height, width = image.shape[:2]
    sides = [np.rint(edge + box[:2] + sign * ASIDE_PX * across).astype(int) for sign in (1, -1)]
    inside = np.all([((q > 0) & (q < (width - 1, height - 1))).all(axis=1) for q in sides], axis=0)
    (u, v), (x, y) = (q[inside].T for q in sides)
    known = (mean[v, u, 0] >= 0) & (mean[y, x, 0] >= 0)
    if np.count_nonzero(known) < _LEAST_EDGE:
        return None
    (u, v), (x, y) = (u[known], v[known]), (x[known], y[known])
    left, top = min(u.min(), x.min()), min(v.min(), y.min())
    right, bottom = max(u.max(), x.max()), max(v.max(), y.max())
    now = cv2.blur(image[top - 1 : bottom + 2, left - 1 : right + 2], (3, 3)).astype(np.float32)
    step = np.abs(now[v - top + 1, u - left + 1] - now[y - top + 1, x - left + 1]).max(axis=1)
    before = np.abs(mean[v, u].astype(np.float32) - mean[y, x]).max(axis=1)
    return float(np.mean(gain * before > step))
