"""What is counted pixel by pixel for an outline, compiled by numba: a region is so small, some 30 × 30 px, that on
arrays nearly all the time would go into calling them.

Each function is compiled when it is first called, which takes seconds once; the code is then kept beside this file.
Arrays are to be C-ordered and writable: for any other kind it would be compiled anew.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pps_vision.types import Image, Mask

_SHADE_STD = 0.4  # how much the rim's brightness differs from that of the object just inside it
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: in this unit a + b is as sure to be 1 as a pixel its level
_LEVEL_VAR = 1.0  # grey levels²: of rounding and the like
_LEAST_DET = 0.04  # grey levels⁴, below which both colours are the same
_EDGE, _INNER, _OUTER = 0, 1, 2

Map = NDArray[np.float32]
Color = tuple[float, float, float]
Box = tuple[int, int, int, int]  # top, bottom, left, right


@njit(cache=True, error_model="numpy")
def covered(patch: Image, mask: Mask, band: int) -> tuple[Map, Map]:
    """Share of each pixel (h, w) that the object covers, and its variance, 0 where it is plain; of an RGB patch
    (h, w, 3) and a hard mask of it (h, w), up to `band` px off whose edge a pixel may be partly covered."""
    height, width = mask.shape
    kind = _kinds(mask, band)
    sums = _color_sums(patch, kind)
    alpha, variance = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    reach, misfit, edge = 2 * band + 2, 0.0, 0
    for y in range(height):
        for x in range(width):
            if kind[y, x] == _INNER:
                alpha[y, x] = 1
            elif kind[y, x] == _EDGE:
                box = max(y - reach, 0), min(y + reach + 1, height), max(x - reach, 0), min(x + reach + 1, width)
                color = float(patch[y, x, 0]), float(patch[y, x, 1]), float(patch[y, x, 2])
                a, b, rest, contrast = _unmixed(color, _mean(sums, 0, box), _mean(sums, 4, box))
                alpha[y, x], variance[y, x] = a / max(a + b, 1e-6), contrast
                misfit += rest
                edge += 1
    noise = misfit / max(3 * edge, 1) + _LEVEL_VAR
    for y in range(height):
        for x in range(width):
            if kind[y, x] == _EDGE:
                variance[y, x] = noise / max(variance[y, x], 4 * noise)  # a quarter at most
    return alpha, variance


@njit(cache=True, error_model="numpy")
def _kinds(mask: Mask, band: int) -> NDArray[np.uint8]:
    """(h, w) whether within `band` px all is marked, nothing, or some; where nowhere all is, the mask is inside."""
    height, width = mask.shape
    kind, inner = np.empty((height, width), np.uint8), 0
    columns = np.zeros(width, np.int32)  # marked in each, of the rows within the band
    for y in range(-band, band):
        for x in range(width):
            columns[x] += mask[min(max(y, 0), height - 1), x]
    for y in range(height):
        for x in range(width):
            columns[x] += mask[min(y + band, height - 1), x]
        count = (band + 1) * columns[0]
        for x in range(1, band):
            count += columns[min(x, width - 1)]
        for x in range(width):
            count += columns[min(x + band, width - 1)]
            whole = count == (2 * band + 1) ** 2
            kind[y, x] = _INNER if whole else _OUTER if count == 0 else _EDGE
            inner += whole
            count -= columns[max(x - band, 0)]
        for x in range(width):
            columns[x] -= mask[max(y - band, 0), x]
    if inner == 0:
        for y in range(height):
            for x in range(width):
                if mask[y, x]:
                    kind[y, x] = _INNER
    return kind


@njit(cache=True, error_model="numpy")
def _color_sums(patch: Image, kind: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(h + 1, w + 1, 8) red, green, blue and the number of all inner, and of all outer pixels above and left, for at
    most 8 million pixels."""
    height, width = kind.shape
    sums = np.zeros((height + 1, width + 1, 8), np.int32)
    row = np.empty(8, np.int32)
    for y in range(height):
        row[:] = 0
        for x in range(width):
            if kind[y, x] != _EDGE:
                first = 0 if kind[y, x] == _INNER else 4
                for channel in range(3):
                    row[first + channel] += patch[y, x, channel]
                row[first + 3] += 1
            for channel in range(8):
                sums[y + 1, x + 1, channel] = sums[y, x + 1, channel] + row[channel]
    return sums


@njit(cache=True, error_model="numpy")
def _mean(sums: NDArray[np.int32], first: int, box: Box) -> Color:
    """Mean colour of the inner (`first` 0) or outer (4) pixels in a box; of all of them where none is in it."""
    n = _sum(sums, first + 3, box)
    if n == 0:
        box = 0, len(sums) - 1, 0, sums.shape[1] - 1
        n = max(_sum(sums, first + 3, box), 1)
    share = 1 / n
    return _sum(sums, first, box) * share, _sum(sums, first + 1, box) * share, _sum(sums, first + 2, box) * share


@njit(cache=True, error_model="numpy")
def _sum(sums: NDArray[np.int32], channel: int, box: Box) -> int:
    top, bottom, left, right = box
    whole, above = sums[bottom, right, channel], sums[top, right, channel]
    return whole - above - sums[bottom, left, channel] + sums[top, left, channel]


@njit(cache=True, error_model="numpy")
def _unmixed(pixel: Color, inner: Color, outer: Color) -> tuple[float, float, float, float]:
    """Shares a and b of two colours in a pixel's, the squares of what they leave of it, and how far they differ.

    A fourth channel, `UNIT` in all three, asks of the mixture that a + b = 1.
    """
    (i0, i1, i2), (f0, f1, f2), (b0, b1, b2), one = pixel, inner, outer, UNIT * UNIT
    ff, bb = f0 * f0 + f1 * f1 + f2 * f2 + one, b0 * b0 + b1 * b1 + b2 * b2 + one
    fb = f0 * b0 + f1 * b1 + f2 * b2 + one
    fi, bi = f0 * i0 + f1 * i1 + f2 * i2 + one, b0 * i0 + b1 * i1 + b2 * i2 + one
    det = max(ff * bb - fb * fb, _LEAST_DET)  # Cramer's rule
    a, b = max(bb * fi - fb * bi, 0.0) / det, max(ff * bi - fb * fi, 0.0) / det
    r0, r1, r2 = i0 - a * f0 - b * b0, i1 - a * f1 - b * b1, i2 - a * f2 - b * b2
    return a, b, r0 * r0 + r1 * r1 + r2 * r2, ff + bb - 2 * fb


class Moments(NamedTuple):
    """Of what is covered: the sums of its directions times their solid angles, and of these, `omega` sr; the upper
    half of their covariance (4, 4) were pixels to err apart, row by row; area px, and what of it lies more than a
    pixel's side outside the cone of that solid angle around that direction; x, y, width, height of what is covered
    by half."""

    direction: Color
    omega: float
    cov: tuple[float, float, float, float, float, float, float, float, float, float]
    area: float
    outside: float
    box: tuple[int, int, int, int]


@njit(cache=True, error_model="numpy")
def moments(alpha: Map, variance: Map, weights: Map, left: int, top: int) -> Moments:
    """Of a region (h, w) of the image, whose corner is there, as `covered` has it; `weights` (4, height, width) are
    each pixel's solid angle times its direction, and its solid angle."""
    height, width = alpha.shape
    x = y = z = omega = area = xx = xy = xz = xo = yy = yz = yo = zz = zo = oo = 0.0
    x0, x1, y0, y1 = width, 0, height, 0
    for row in range(height):
        for column in range(width):
            share, spread = float(alpha[row, column]), float(variance[row, column])
            if share == 0 and spread == 0:
                continue
            v, u = top + row, left + column
            a, b, c, d = (
                float(weights[0, v, u]),
                float(weights[1, v, u]),
                float(weights[2, v, u]),
                float(weights[3, v, u]),
            )
            x, y, z, omega, area = x + share * a, y + share * b, z + share * c, omega + share * d, area + share
            if share > 0.5:
                x0, x1, y0, y1 = min(x0, column), max(x1, column + 1), min(y0, row), max(y1, row + 1)
            if spread > 0:
                xx, xy, xz, xo = xx + spread * a * a, xy + spread * a * b, xz + spread * a * c, xo + spread * a * d
                yy, yz, yo = yy + spread * b * b, yz + spread * b * c, yo + spread * b * d
                zz, zo, oo = zz + spread * c * c, zo + spread * c * d, oo + spread * d * d
    cov = (xx, xy, xz, xo, yy, yz, yo, zz, zo, oo)
    direction = (x, y, z)
    outside = _outside(alpha, weights, left, top, direction, omega, area)
    return Moments(direction, omega, cov, area, outside, (x0, y0, max(x1 - x0, 0), max(y1 - y0, 0)))


@njit(cache=True, error_model="numpy")
def _outside(alpha: Map, weights: Map, left: int, top: int, direction: Color, omega: float, area: float) -> float:
    """What of the region lies more than a pixel's side outside the cone of a solid angle around a direction, px."""
    x, y, z = direction
    reach = math.acos(1 - min(omega / (2 * math.pi), 1.0)) + math.sqrt(max(omega, 0.0) / max(area, 1.0))
    cosine, outside = math.sqrt(x * x + y * y + z * z) * math.cos(reach), 0.0
    for row in range(len(alpha)):
        for column in range(alpha.shape[1]):
            if alpha[row, column] > 0:
                v, u = top + row, left + column
                along = x * weights[0, v, u] + y * weights[1, v, u] + z * weights[2, v, u]
                if along < cosine * weights[3, v, u]:
                    outside += alpha[row, column]
    return outside
