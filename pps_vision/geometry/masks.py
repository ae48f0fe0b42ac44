"""Operations on boolean pixel masks (h, w)."""

import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

Box = tuple[int, int, int, int]  # x0, y0, x1, y1: pixels x0 … x1 − 1
BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height
_SMALL_HOLE = 0.01  # share of the mask; smaller holes are noise


@cache
def square(radius: int) -> NDArray[np.uint8]:
    """Square structuring element of side 2·radius + 1."""
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)


def dilated(mask: Mask, radius: int) -> Mask:
    """The mask dilated by `radius` px to all sides."""
    return np.asarray(cv2.dilate(mask.view(np.uint8), square(radius)), dtype=np.uint8).view(bool)


def closed(mask: Mask, element: NDArray[np.uint8]) -> Mask:
    """The mask with gaps narrower than the element filled."""
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, element), dtype=np.uint8).view(bool)


def opened(mask: Mask, radius: int) -> Mask:
    """The mask without parts into which no disc of that radius fits; the image's border counts as part of the mask.

    Takes time linear in the pixels.
    """
    return _within(~_within(~mask, radius), radius)


@njit(cache=True, error_model="numpy")
def _within(mask: Mask, radius: int) -> Mask:
    """Pixels (h, w) at most `radius` px from the mask: in each row, the union of the chords of the circles around the
    nearest mask pixel of every column."""
    height, width = mask.shape
    beyond = radius + 1
    away = np.empty((height, width), np.int32)  # distance to the nearest mask pixel of the column, at most `beyond`
    for column in range(width):
        away[0, column] = 0 if mask[0, column] else beyond
    for row in range(1, height):
        for column in range(width):
            away[row, column] = 0 if mask[row, column] else min(away[row - 1, column] + 1, beyond)
    for row in range(height - 2, -1, -1):
        for column in range(width):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1)
    half = np.empty(radius + 1, np.int32)  # half chord of the circle at this distance from its centre
    for k in range(radius + 1):
        half[k] = int(math.sqrt(radius * radius - k * k))
    within = np.empty((height, width), np.bool_)
    begun = np.empty(width + 1, np.int32)  # number of chords that begin minus number that end there
    for row in range(height):
        begun[:] = 0
        for column in range(width):
            if away[row, column] <= radius:
                reach = half[away[row, column]]
                begun[max(column - reach, 0)] += 1
                begun[min(column + reach + 1, width)] -= 1
        count = 0
        for column in range(width):
            count += begun[column]
            within[row, column] = count > 0
    return within


def component(mask: Mask, where: Mask) -> Mask | None:
    """The connected component with most pixels in `where`; None if no component has any."""
    count, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    votes = np.bincount(np.asarray(labels)[where], minlength=count)
    votes[0] = 0
    return np.asarray(labels == int(votes.argmax())) if votes.any() else None


def filled(mask: Mask, backdrop: Mask | None = None) -> Mask:
    """The mask with its holes filled, except large holes that are mostly `backdrop`."""
    whole = mask.view(np.uint8).copy()
    contours, _ = cv2.findContours(whole, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(whole, contours, -1, (1,), cv2.FILLED)
    holes = (whole > mask.view(np.uint8)).view(np.uint8)
    least = _SMALL_HOLE * np.count_nonzero(mask)
    if backdrop is not None and np.count_nonzero(holes) > least:
        count, labels, stats, _ = cv2.connectedComponentsWithStats(holes, connectivity=4)
        behind = np.bincount(np.asarray(labels)[backdrop], minlength=count)
        for k in range(1, count):
            if stats[k, cv2.CC_STAT_AREA] > least and 2 * behind[k] > stats[k, cv2.CC_STAT_AREA]:
                whole[np.asarray(labels) == k] = 0
    return whole.view(bool)


def closed_component(mask: Mask, where: Mask, backdrop: Mask | None = None) -> Mask | None:
    """The `component` of the mask after gaps of up to 2 px were closed, with its holes `filled`."""
    connected = component(closed(mask, square(1)), where)
    return None if connected is None else filled(connected, backdrop)


def centroid(mask: Mask, box: tuple[int, int, int, int]) -> Array:
    """(2,) px centroid of a mask (h, w) of the region `box` (x0, y0, x1, y1), in the image's coordinates."""
    moments = cv2.moments(mask.view(np.uint8), binaryImage=True)
    return np.array([box[0] + moments["m10"] / moments["m00"], box[1] + moments["m01"] / moments["m00"]])


def is_cut(mask: Mask, box: tuple[int, int, int, int], image: Image) -> bool:
    """Whether a mask (h, w) of the region `box` (x0, y0, x1, y1) may continue outside it, within the image."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box
    sides = (mask[:, 0], x0 > 0), (mask[0], y0 > 0), (mask[:, -1], x1 < width), (mask[-1], y1 < height)
    return any(inner and bool(side.any()) for side, inner in sides)


def contour(mask: Mask) -> NDArray[np.int32]:
    """(n, 2) pixels x, y along the longest outer edge of a mask, in their order."""
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(max(contours, key=len)[:, 0], np.int32)


def hull(mask: Mask) -> Mask:
    """The convex hull of a mask."""
    whole = np.zeros(mask.shape, np.uint8)
    points = cv2.findNonZero(mask.view(np.uint8))
    if points is not None:
        cv2.fillConvexPoly(whole, cv2.convexHull(points), (1,))
    return whole.view(bool)


def solidity(mask: Mask) -> float:
    """Share of its convex hull that a connected mask fills."""
    hull = cv2.convexHull(contour(mask))
    return float(np.count_nonzero(mask)) / max(float(cv2.contourArea(hull)), 1.0)


def ellipse(box: tuple[int, int, int, int], center: Array, width: float, height: float) -> Mask:
    """Pixels of the region `box` (x0, y0, x1, y1) inside the ellipse of this width and height around `center`."""
    return _ellipse(box, (float(center[0]), float(center[1])), float(width), float(height))


@njit(cache=True, error_model="numpy")
def _ellipse(box: tuple[int, int, int, int], center: tuple[float, float], width: float, height: float) -> Mask:
    x0, y0, x1, y1 = box
    across = np.empty(max(x1 - x0, 0))
    for column in range(len(across)):
        across[column] = (2 * (x0 + column - center[0]) / width) ** 2
    inside = np.empty((max(y1 - y0, 0), len(across)), np.bool_)
    for row in range(len(inside)):
        along = (2 * (y0 + row - center[1]) / height) ** 2
        for column in range(len(across)):
            inside[row, column] = across[column] + along <= 1
    return inside


def clipped(box: Box, width: int, height: int) -> Box:
    """Intersection of a box with an image of that size (px)."""
    x0, y0, x1, y1 = box
    return max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)


def contains(outer: Box, inner: Box) -> bool:
    """Whether a box contains another one."""
    return outer[0] <= inner[0] and outer[1] <= inner[1] and inner[2] <= outer[2] and inner[3] <= outer[3]
