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

_SHIFT, _HALF = 12, 1 << 11  # OpenCV's fixed point for hue and saturation
_PER_VALUE = np.rint((255 << _SHIFT) / np.maximum(np.arange(256), 1)).astype(np.int64)
_PER_SPREAD = np.rint((180 << _SHIFT) / (6 * np.maximum(np.arange(256), 1))).astype(np.int64)

Map = NDArray[np.float32]
Labels = NDArray[np.int32]
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
    reach, misfit, edge, within = 2 * band + 2, 0.0, 0, np.empty(8, np.int32)
    for y in range(height):
        for x in range(width):
            if kind[y, x] == _INNER:
                alpha[y, x] = 1
            elif kind[y, x] == _EDGE:
                box = max(y - reach, 0), min(y + reach + 1, height), max(x - reach, 0), min(x + reach + 1, width)
                color = float(patch[y, x, 0]), float(patch[y, x, 1]), float(patch[y, x, 2])
                inner, outer = _means(sums, box, within)
                a, b, rest, contrast = _unmixed(color, inner, outer)
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
def _means(sums: NDArray[np.int32], box: Box, within: NDArray[np.int32]) -> tuple[Color, Color]:
    """Mean colours of the inner and of the outer pixels in a box, of all of them where none is in it; `within` (8,) is
    room to reckon in."""
    top, bottom, left, right = box
    a, b, c, d = sums[bottom, right], sums[top, right], sums[bottom, left], sums[top, left]
    for channel in range(8):
        within[channel] = a[channel] - b[channel] - c[channel] + d[channel]
    every = sums[-1, -1]
    return _mean(within if within[3] else every, 0), _mean(within if within[7] else every, 4)


@njit(cache=True, error_model="numpy")
def _mean(sums: NDArray[np.int32], first: int) -> Color:
    share = 1 / max(sums[first + 3], 1)
    return sums[first] * share, sums[first + 1] * share, sums[first + 2] * share


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


class Hues(NamedTuple):
    """What is a marker's: hues from `low` to `high` (0–179; from low on and up to high where that is less), the least
    saturation and value (0–255), and the fewest pixels."""

    low: int
    high: int
    saturation: int
    value: int
    area: int


@njit(cache=True, error_model="numpy")
def marker(
    image: Image, hues: Hues, around: Box, clear: int, pad: int, weights: Map
) -> tuple[bool, Map, Map, Box, Moments]:
    """Whether within the box `around` there is one blob of a marker's hue, and nothing of it within `clear` px of the
    box's border; and if so its coverage in a box of its own with `pad` px of room around, as `covered` and `moments`
    have it."""
    top, _, left, _ = around
    label = _of_hue(image, hues, around)
    one, box = _one_blob(label, hues.area)
    y0, y1, x0, x1 = box
    height, width = label.shape
    if one == 0 or min(y0, x0) < clear or y1 > height - clear or x1 > width - clear:
        empty = np.zeros((0, 0), np.float32)
        return False, empty, empty, (0, 0, 0, 0), moments(empty, empty, weights, 0, 0)
    _fill(label, one, box)
    room = (
        max(top + y0 - pad, 0),
        min(top + y1 + pad, image.shape[0]),
        max(left + x0 - pad, 0),
        min(left + x1 + pad, image.shape[1]),
    )
    mask, n = np.zeros((room[1] - room[0], room[3] - room[2]), np.bool_), 0
    for y in range(y0, y1):
        for x in range(x0, x1):
            if label[y, x] == one:
                mask[top + y - room[0], left + x - room[2]] = True
                n += 1
    patch = image[room[0] : room[1], room[2] : room[3]].copy()
    alpha, variance = covered(patch, mask, 2 if n > 60 else 1)
    return True, alpha, variance, room, moments(alpha, variance, weights, room[2], room[0])


@njit(cache=True, error_model="numpy")
def _of_hue(image: Image, hues: Hues, around: Box) -> Labels:
    """(h, w) -1 where the box has a marker's hue, else 0; hue and saturation as OpenCV rounds them."""
    top, bottom, left, right = around
    label = np.zeros((bottom - top, right - left), np.int32)
    for y in range(bottom - top):
        for x in range(right - left):
            v, u = top + y, left + x
            r, g, b = np.int64(image[v, u, 0]), np.int64(image[v, u, 1]), np.int64(image[v, u, 2])
            value = max(r, g, b)
            spread = value - min(r, g, b)
            if value < hues.value or (spread * _PER_VALUE[value] + _HALF) >> _SHIFT < hues.saturation:
                continue
            part = g - b if value == r else b - r + 2 * spread if value == g else r - g + 4 * spread
            hue = (part * _PER_SPREAD[spread] + _HALF) >> _SHIFT
            if hue < 0:
                hue += 180
            within = hue >= hues.low, hue <= hues.high
            if (within[0] and within[1]) if hues.low <= hues.high else (within[0] or within[1]):
                label[y, x] = -1
    return label


@njit(cache=True, error_model="numpy")
def _one_blob(label: Labels, area: int) -> tuple[int, Box]:
    """Give all that hangs together (corners too) where the label is -1 a number of its own from 1 on; the number of
    the only one of at least that area, 0 where there is none or more, and its box."""
    height, width = label.shape
    stack, n, one, box = np.empty((label.size, 2), np.int64), 0, 0, (0, 0, 0, 0)
    for row in range(height):
        for column in range(width):
            if label[row, column] != -1:
                continue
            n += 1
            label[row, column] = n
            stack[0, 0], stack[0, 1], waiting, count = row, column, 1, 0
            y0, y1, x0, x1 = height, 0, width, 0
            while waiting:
                waiting -= 1
                y, x = stack[waiting, 0], stack[waiting, 1]
                y0, y1, x0, x1, count = min(y0, y), max(y1, y + 1), min(x0, x), max(x1, x + 1), count + 1
                for v in range(max(y - 1, 0), min(y + 2, height)):
                    for u in range(max(x - 1, 0), min(x + 2, width)):
                        if label[v, u] == -1:
                            label[v, u] = n
                            stack[waiting, 0], stack[waiting, 1] = v, u
                            waiting += 1
            if count >= area:
                if one:
                    return 0, box
                one, box = n, (y0, y1, x0, x1)
    return one, box


@njit(cache=True, error_model="numpy")
def _fill(label: Labels, one: int, box: Box) -> None:
    """Label with `one` what it encloses in its box, sides only: what the rest does not reach from the box's border."""
    y0, y1, x0, x1 = box
    outside, waiting = np.zeros((y1 - y0, x1 - x0), np.bool_), 0
    stack = np.empty(((y1 - y0) * (x1 - x0), 2), np.int64)
    for y in range(y0, y1):
        for x in range(x0, x1):
            if (y in (y0, y1 - 1) or x in (x0, x1 - 1)) and label[y, x] != one:
                outside[y - y0, x - x0] = True
                stack[waiting, 0], stack[waiting, 1] = y, x
                waiting += 1
    while waiting:
        waiting -= 1
        y, x = stack[waiting, 0], stack[waiting, 1]
        for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if y0 <= v < y1 and x0 <= u < x1 and label[v, u] != one and not outside[v - y0, u - x0]:
                outside[v - y0, u - x0] = True
                stack[waiting, 0], stack[waiting, 1] = v, u
                waiting += 1
    for y in range(y0, y1):
        for x in range(x0, x1):
            if not outside[y - y0, x - x0]:
                label[y, x] = one
