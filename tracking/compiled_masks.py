"""Masks and boxes counted pixel by pixel, compiled by numba as in `compiled`."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pps_vision.types import Array, Mask
from tracking.compiled import Map
from tracking.ego_motion import Box


@njit(cache=True, error_model="numpy")
def hollowness(alpha: Map) -> float:
    """What share of the convex hull of all pixels (h, w) that are covered by half is not: 0 for what is convex, however
    few its pixels.  A hull holds area + border / 2 + 1 of them, with those on its border (Pick)."""
    height, width = alpha.shape
    rows, counted = 0, 0
    y, left, right = np.empty(height, np.int64), np.empty(height, np.int64), np.empty(height, np.int64)
    for row in range(height):
        first, last = width, -1
        for column in range(width):
            if alpha[row, column] > 0.5:
                first, last = min(first, column), column
                counted += 1
        if last >= 0:
            y[rows], left[rows], right[rows] = row, first, -last
            rows += 1
    if rows == 0:
        return 0.0
    outer, on_left = _side(y[:rows], left[:rows])
    other, on_right = _side(y[:rows], right[:rows])
    border = on_left + on_right - right[0] - left[0] - right[rows - 1] - left[rows - 1]
    return 1 - counted / (-(outer + other) + border / 2 + 1)


@njit(cache=True, error_model="numpy")
def _side(y: NDArray[np.int64], x: NDArray[np.int64]) -> tuple[float, int]:
    """The area between the axis and the left convex border of points that rise in y, and the pixels it steps over."""
    kept = np.empty(len(y), np.int64)
    n = 0
    for k in range(len(y)):
        while n > 1:
            a, b = kept[n - 2], kept[n - 1]
            if (x[b] - x[a]) * (y[k] - y[a]) < (x[k] - x[a]) * (y[b] - y[a]):
                break
            n -= 1
        kept[n] = k
        n += 1
    area, steps = 0.0, 0
    for k in range(1, n):
        a, b = kept[k - 1], kept[k]
        area += 0.5 * (x[a] + x[b]) * (y[b] - y[a])
        steps += math.gcd(y[b] - y[a], abs(x[b] - x[a]))
    return area, steps


@njit(cache=True, error_model="numpy")
def box_sums(integral: Array, cloud: Array, left: int, top: int, half_width: float, half_height: float) -> Array:
    """(n,) what an integral image (h + 1, w + 1), whose corner is there, has in each box of a cloud (n, 3): x, y of its
    centre and its scale, times which half its sides are given."""
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    sums = np.empty(len(cloud))
    for k in range(len(cloud)):
        x, y, scale = cloud[k, 0] - left + 0.5, cloud[k, 1] - top + 0.5, cloud[k, 2]
        x0, x1 = _clipped(x - scale * half_width, width), _clipped(x + scale * half_width, width)
        y0, y1 = _clipped(y - scale * half_height, height), _clipped(y + scale * half_height, height)
        sums[k] = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
    return sums


@njit(cache=True, error_model="numpy")
def _clipped(value: float, most: int) -> int:
    return min(max(round(value), 0), most)


@njit(cache=True, error_model="numpy")
def in_ellipse(box: Box, x: float, y: float, half_width: float, half_height: float) -> Mask:
    """(h, w) which pixels of a region (left, top, right, bottom) lie in an ellipse around a point."""
    left, top, right, bottom = box
    inside = np.empty((bottom - top, right - left), np.bool_)
    for v in range(bottom - top):
        up = ((top + v - y) / half_height) ** 2
        for u in range(right - left):
            inside[v, u] = ((left + u - x) / half_width) ** 2 + up <= 1.0
    return inside
