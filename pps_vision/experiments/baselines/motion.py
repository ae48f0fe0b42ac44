"""Baselines of the motion trigger: R's grid of optical flow, and the difference of images.

Each fires above one level, which the study chooses. All take the same central part of the image (R's grid its own
75 %) and join pixels to regions in the same way.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image
from tracking.camera_pose import EgoMotion

BoxPx = tuple[int, int, int, int]  # x, y of the top-left corner, width, height
MotionTrigger = Callable[[Image, View], list[BoxPx]]  # the next image of one camera to its moving regions
GreyView = tuple[NDArray[np.uint8], View]

_ROOM_M = 1.2  # distance for which the motion of the image before a moving eye is predicted
_CENTRAL = 0.92
_MIN_AREA_PX = 16
_JOIN_PX = 4
_STEP = 6  # of R's grid (its motionCUT module)
_WINDOW = 15
_LEVELS = 5
_CENTRAL_R = 0.75
_MIN_NEIGHBOURS = 4
_MIN_NODES = 10


def regions(on: NDArray[np.bool_]) -> list[BoxPx]:
    """Return the boxes of the regions, joined across small gaps, of the central part of a mask (h, w)."""
    height, width = on.shape
    mx = round((1 - _CENTRAL) / 2 * width)
    my = round((1 - _CENTRAL) / 2 * height)
    central = np.ascontiguousarray(on[my : height - my, mx : width - mx]).view(np.uint8)
    if np.count_nonzero(central) < _MIN_AREA_PX:
        return []
    side = 2 * _JOIN_PX + 1
    joined = cv2.morphologyEx(central, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(joined)
    area = np.bincount(np.asarray(labels)[central > 0], minlength=len(stats))
    large = np.flatnonzero(area[1:] >= _MIN_AREA_PX) + 1
    return [(int(stats[k, 0]) + mx, int(stats[k, 1]) + my, int(stats[k, 2]), int(stats[k, 3])) for k in large]


def _of_pairs(compare: Callable[[GreyView, GreyView], list[BoxPx]]) -> MotionTrigger:
    """A trigger that compares each image with the one before it."""
    last: list[GreyView] = []

    def step(image: Image, view: View) -> list[BoxPx]:
        current = (np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8), view)
        boxes = compare(last.pop(), current) if last else []
        last.append(current)
        return boxes

    return step


def _residual_grid(level: float, previous: GreyView, current: GreyView) -> list[BoxPx]:
    """R's trigger: nodes whose patch pyramidal Lucas–Kanade does not find again (mean difference, grey levels).

    Regions have more than 10 nodes, of which each has 4 of 8 neighbours.
    """
    height, width = current[0].shape
    m = (1 - _CENTRAL_R) / 2
    y, x = np.mgrid[int(m * height) : int((1 - m) * height) : _STEP, int(m * width) : int((1 - m) * width) : _STEP]
    nodes = np.stack([x, y], axis=-1).astype(np.float32).reshape(-1, 1, 2)
    _, is_matched, residual = cv2.calcOpticalFlowPyrLK(
        previous[0], current[0], nodes, np.empty_like(nodes), winSize=(_WINDOW, _WINDOW), maxLevel=_LEVELS - 1
    )
    mask = ((residual > level) | (is_matched == 0)).reshape(x.shape).astype(np.uint8)
    neighbours = cv2.filter2D(mask, -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT) - mask
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask * (np.asarray(neighbours) >= _MIN_NEIGHBOURS).view(np.uint8))
    corner = x[0, 0] - _STEP // 2, y[0, 0] - _STEP // 2
    return [
        (int(corner[0] + _STEP * a), int(corner[1] + _STEP * b), int(_STEP * w), int(_STEP * h))
        for a, b, w, h, area in np.asarray(stats)[1:]
        if area > _MIN_NODES
    ]


def _warped_difference(camera: Camera, level: float) -> MotionTrigger:
    """Brighter or darker by a level than the last image warped to the present view."""
    ego = EgoMotion(camera)

    def compare(previous: GreyView, current: GreyView) -> list[BoxPx]:
        old, new = (cv2.blur(grey, (3, 3)) for grey, _ in (previous, current))
        if not ego.is_still(previous[1], current[1]):
            old = ego.warp(np.asarray(old, np.uint8), previous[1], current[1], 1 / _ROOM_M)
            new = np.where(old == 0, old, new)
        return regions(np.asarray(cv2.absdiff(new, old)) > level)

    return _of_pairs(compare)


class Candidate(NamedTuple):
    """A trigger to be made for a camera at one of its `levels`."""

    make: Callable[[Camera, float], MotionTrigger]
    levels: tuple[float, ...]


TRIGGERS: dict[str, Candidate] = {
    "LK residual grid (R)": Candidate(
        lambda _, level: _of_pairs(partial(_residual_grid, level)), (2, 3, 4, 6, 8, 12, 16, 24)
    ),
    "difference, warped": Candidate(_warped_difference, (4, 6, 8, 12, 16, 24, 32, 48, 64)),
}
