"""Numba kernels of the sub-pixel outline: pixel coverage and its moments.

A region has about 30 × 30 px, so that the overhead of array operations would dominate.  The first call compiles and
takes seconds; the machine code is cached beside this file.  Arrays must be C-ordered and writable; another layout
compiles the function again.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

_SHADE_STD = 0.4  # relative standard deviation of the rim's brightness from that of the object just inside it
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: weight of the condition a + b = 1 beside one pixel's level
_LEVEL_VAR = 1.0  # grey levels²: smallest variance of a pixel (rounding)
_MIN_DET = 0.04  # grey levels⁴, below which both colours are the same
_MASK_VAR = 1 / 12  # variance of the hard mask as an estimate of a pixel's share: an edge anywhere in the pixel
_EDGE = 0
_INNER = 1
_OUTER = 2

Map = NDArray[np.float32]
Color = tuple[float, float, float]


@njit(cache=True, error_model="numpy")
def covered(patch: Image, mask: Mask, band: int) -> tuple[Map, Map]:
    """Share of each pixel (h, w) that the object covers, and its variance (h, w), 0 where the share is certain.

    At an edge it is the mean of two estimates, weighted by their inverse variances: the mixture of the colours inside
    and outside, and the hard mask, which decides where the pixel's colour is no such mixture.

    Args:
        patch: (h, w, 3) RGB.
        mask: (h, w) hard mask of the object.
        band: Distance from the mask's edge, px, up to which a pixel may be partly covered.
    """
    height, width = mask.shape
    kind = _kinds(mask, band)
    alpha = np.zeros((height, width), np.float32)
    variance = np.zeros((height, width), np.float32)
    reach = 2 * band + 2
    all_columns = np.zeros((width, 8), np.int32)
    for y in range(height):
        _add_colors(all_columns, patch[y], kind[y], 1)
    whole = all_columns.sum(axis=0).astype(np.int32)
    columns = np.zeros((width, 8), np.int32)  # sums of the rows within reach
    sums = np.zeros((width + 1, 8), np.int32)  # cumulated over the columns
    window = np.empty(8, np.int32)
    for y in range(-reach, height):
        if y + reach < height:
            _add_colors(columns, patch[y + reach], kind[y + reach], 1)
        if y > reach:
            _add_colors(columns, patch[y - reach - 1], kind[y - reach - 1], -1)
        if y < 0:
            continue
        for x in range(width):
            for channel in range(8):
                sums[x + 1, channel] = sums[x, channel] + columns[x, channel]
        for x in range(width):
            if kind[y, x] == _INNER:
                alpha[y, x] = 1
            elif kind[y, x] == _EDGE:
                left = max(x - reach, 0)
                right = min(x + reach + 1, width)
                for channel in range(8):
                    window[channel] = sums[right, channel] - sums[left, channel]
                color = (float(patch[y, x, 0]), float(patch[y, x, 1]), float(patch[y, x, 2]))
                inner = _mean(window if window[3] else whole, 0)
                outer = _mean(window if window[7] else whole, 4)
                a, b, residual2, contrast2 = _unmixed(color, inner, outer)
                noise = residual2 / 3 + _LEVEL_VAR  # variance of the mixture: noise / contrast2
                signal = _MASK_VAR * contrast2
                weight = signal / (noise + signal)
                alpha[y, x] = weight * a / max(a + b, 1e-6) + (1 - weight) * mask[y, x]
                variance[y, x] = noise * _MASK_VAR / (noise + signal)
    return alpha, variance


@njit(cache=True, error_model="numpy")
def _kinds(mask: Mask, band: int) -> NDArray[np.uint8]:
    """(h, w) `_INNER` where all pixels within `band` px are marked, `_OUTER` where none is, else `_EDGE`.  If no pixel
    is inner, all marked pixels are."""
    height, width = mask.shape
    kind = np.empty((height, width), np.uint8)
    inner = 0
    whole = (2 * band + 1) ** 2
    columns = np.zeros(width + 2 * band, np.uint8)  # marked pixels of each column, of the rows within the band
    count = np.empty(width, np.uint8)
    for y in range(-2 * band, height):
        entering = mask[min(max(y + band, 0), height - 1)]
        leaving = mask[max(y - band - 1, 0)]
        within = columns[band : band + width]
        for x in range(width):
            within[x] += entering[x]
        if y > 0:
            for x in range(width):
                within[x] -= leaving[x]
        if y < 0:
            continue
        for k in range(band):
            columns[k] = within[0]
            columns[band + width + k] = within[width - 1]
        for x in range(width):
            count[x] = 0
        for k in range(2 * band + 1):
            shifted = columns[k : k + width]
            for x in range(width):
                count[x] += shifted[x]
        row = kind[y]
        for x in range(width):
            row[x] = _EDGE if 0 < count[x] < whole else _OUTER if count[x] == 0 else _INNER
            inner += count[x] == whole
    if inner == 0:
        for y in range(height):
            for x in range(width):
                if mask[y, x]:
                    kind[y, x] = _INNER
    return kind


@njit(cache=True, error_model="numpy")
def _add_colors(columns: NDArray[np.int32], row: Image, kind: NDArray[np.uint8], times: int) -> None:
    """Add a row (w, 3) of pixels to the sums of the `columns` (w, 8) in place: red, green, blue and number of the inner
    pixels, then of the outer pixels."""
    for x in range(len(row)):
        if kind[x] != _EDGE:
            first = 0 if kind[x] == _INNER else 4
            columns[x, first] += times * row[x, 0]
            columns[x, first + 1] += times * row[x, 1]
            columns[x, first + 2] += times * row[x, 2]
            columns[x, first + 3] += times


@njit(cache=True, error_model="numpy")
def _mean(sums: NDArray[np.int32], first: int) -> Color:
    share = 1 / max(sums[first + 3], 1)
    return sums[first] * share, sums[first + 1] * share, sums[first + 2] * share


@njit(cache=True, error_model="numpy")
def _unmixed(pixel: Color, inner: Color, outer: Color) -> tuple[float, float, float, float]:
    """Shares a, b of the inner colour F and the outer colour B in a pixel's colour I: least squares of I = a F + b B.

    A fourth channel, `UNIT` in all three, weighs the condition a + b = 1.

    Returns:
        a, b, the squared residual |I − a F − b B|², and |F − B|².
    """
    i0, i1, i2 = pixel
    f0, f1, f2 = inner
    b0, b1, b2 = outer
    unit2 = UNIT * UNIT
    ff = f0 * f0 + f1 * f1 + f2 * f2 + unit2
    bb = b0 * b0 + b1 * b1 + b2 * b2 + unit2
    fb = f0 * b0 + f1 * b1 + f2 * b2 + unit2
    fi = f0 * i0 + f1 * i1 + f2 * i2 + unit2
    bi = b0 * i0 + b1 * i1 + b2 * i2 + unit2
    det = max(ff * bb - fb * fb, _MIN_DET)  # Cramer's rule
    a = max(bb * fi - fb * bi, 0.0) / det
    b = max(ff * bi - fb * fi, 0.0) / det
    residual2 = (i0 - a * f0 - b * b0) ** 2 + (i1 - a * f1 - b * b1) ** 2 + (i2 - a * f2 - b * b2) ** 2
    return a, b, residual2, ff + bb - 2 * fb


class Moments(NamedTuple):
    """Sums over the covered pixels.

    Attributes:
        direction: (3,) viewing direction times solid angle.
        omega: Solid angle, sr.
        cov: (4, 4) covariance of `direction` and `omega` for independent pixel errors.
        area: px.
        box: x, y, width, height of the pixels that are covered by more than half.
    """

    direction: Color
    omega: float
    cov: Array
    area: float
    box: tuple[int, int, int, int]


@njit(cache=True, error_model="numpy")
def moments(alpha: Map, variance: Map, weights: Map, left: int, top: int) -> Moments:
    """Return the moments of a region (h, w) of the image with its corner at `left`, `top`.

    Args:
        alpha, variance: (h, w) as from `covered`.
        weights: (4, height, width) each pixel's solid angle times its direction, and its solid angle.
    """
    height, width = alpha.shape
    area = 0.0
    sums = np.zeros(4)
    cov = np.zeros((4, 4))
    x0 = width
    y0 = height
    x1 = y1 = 0
    for row in range(height):
        for column in range(width):
            share = float(alpha[row, column])
            var = float(variance[row, column])
            if share == 0 and var == 0:
                continue
            area += share
            for i in range(4):
                weight = float(weights[i, top + row, left + column])
                sums[i] += share * weight
                for j in range(4):
                    cov[i, j] += var * weight * weights[j, top + row, left + column]
            if share > 0.5:
                x0 = min(x0, column)
                x1 = max(x1, column + 1)
                y0 = min(y0, row)
                y1 = max(y1, row + 1)
    direction = (sums[0], sums[1], sums[2])
    return Moments(direction, sums[3], cov, area, (x0, y0, max(x1 - x0, 0), max(y1 - y0, 0)))


@njit(cache=True, error_model="numpy")
def harmonics(
    alpha: Map, weights: Map, left: int, top: int, axis: Color, omega: float
) -> tuple[tuple[float, float, float, float], float]:
    """Return the second and third harmonic of an outline's edge and its non-circularity, as `Outline` has them.

    They are computed in the tangent plane of `axis`, the mean direction, in which a ball's image is a disc.  An edge at
    r(1 + ε cos kθ) has the moment ∫ρᵏ cos kθ dA = ε π r^(k + 2).

    Args:
        alpha, weights, left, top: As for `moments`.
        axis, omega: Direction and solid angle of its result.
    """
    length = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    p = axis[0] / length
    q = axis[1] / length
    r = axis[2] / length
    side = math.sqrt(p * p + r * r)
    ex = r / side  # e = (ex, 0, ez) and f = axis × e span the plane
    ez = -p / side
    fx = q * ez
    fy = r * ex - p * ez
    fz = -q * ex
    c2 = s2 = c3 = s3 = second = 0.0
    for row in range(len(alpha)):
        for column in range(alpha.shape[1]):
            if alpha[row, column] == 0:
                continue
            a = weights[0, top + row, left + column]
            b = weights[1, top + row, left + column]
            c = weights[2, top + row, left + column]
            d = weights[3, top + row, left + column]
            x = (ex * a + ez * c) / d
            y = (fx * a + fy * b + fz * c) / d
            w = float(alpha[row, column]) * d
            c2 += w * (x * x - y * y)
            s2 += w * 2 * x * y
            c3 += w * x * (x * x - 3 * y * y)
            s3 += w * y * (3 * x * x - y * y)
            second += w * (x * x + y * y)
    square = omega * omega / math.pi  # π r⁴
    cube = square * math.sqrt(omega / math.pi)
    return (c2 / square, s2 / square, c3 / cube, s3 / cube), 2 * second / square - 1
