"""Hollowness of a mask, compiled by numba as in `kernels`."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracking.kernels import Map


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
