"""Numba kernels of the sub-pixel outline: pixel coverage and its moments.

A region has about 30 × 30 px, for which the overhead of array operations would take most of the time.  Each function is
compiled on its first call, which takes seconds once; the machine code is cached beside this file.  Arrays must be
C-ordered and writable; for another layout the function is compiled again.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Image, Mask

_SHADE_STD = 0.4  # relative standard deviation of the rim's brightness from that of the object just inside it
_PIXEL_VAR = 16.0  # grey levels²: sensor noise and the background's own grain
UNIT = _PIXEL_VAR**0.5 / _SHADE_STD  # grey levels: weight of the condition a + b = 1 beside one pixel's level
_LEVEL_VAR = 1.0  # grey levels²: least variance of a pixel (rounding)
_LEAST_DET = 0.04  # grey levels⁴, below which both colours are the same
_MASK_VAR = 1 / 12  # of the hard mask as an estimate of a pixel's share: an edge anywhere in the pixel
_EDGE, _INNER, _OUTER = 0, 1, 2

Map = NDArray[np.float32]
Color = tuple[float, float, float]
Upper = tuple[float, float, float, float, float, float, float, float, float, float]


@njit(cache=True, error_model="numpy")
def covered(patch: Image, mask: Mask, band: int) -> tuple[Map, Map]:
    """Share of each pixel (h, w) that the object covers, and its variance (h, w), 0 where the share is certain.

    At an edge it is the mean of two estimates, weighted by their inverse variances: how the pixel mixes the colours
    inside and outside, and the hard mask, which decides where the pixel's colour is no mixture of them.

    Args:
        patch: (h, w, 3) RGB.
        mask: (h, w) hard mask of the object.
        band: Distance from the mask's edge, px, up to which a pixel may be partly covered.
    """
    height, width = mask.shape
    kind = _kinds(mask, band)
    alpha, variance = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    reach, every = 2 * band + 2, np.zeros((width, 8), np.int32)
    for y in range(height):
        _add_colors(every, patch[y], kind[y], 1)
    whole = every.sum(axis=0).astype(np.int32)
    columns, sums, within = np.zeros((width, 8), np.int32), np.zeros((width + 1, 8), np.int32), np.empty(8, np.int32)
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
                left, right = max(x - reach, 0), min(x + reach + 1, width)
                for channel in range(8):
                    within[channel] = sums[right, channel] - sums[left, channel]
                color = float(patch[y, x, 0]), float(patch[y, x, 1]), float(patch[y, x, 2])
                inner, outer = _mean(within if within[3] else whole, 0), _mean(within if within[7] else whole, 4)
                a, b, rest, contrast = _unmixed(color, inner, outer)
                noise, known = rest / 3 + _LEVEL_VAR, _MASK_VAR * contrast
                weight = known / (noise + known)
                alpha[y, x] = weight * a / max(a + b, 1e-6) + (1 - weight) * mask[y, x]
                variance[y, x] = noise * _MASK_VAR / (noise + known)
    return alpha, variance


@njit(cache=True, error_model="numpy")
def _kinds(mask: Mask, band: int) -> NDArray[np.uint8]:
    """(h, w) `_INNER` where all pixels within `band` px are marked, `_OUTER` where none is, else `_EDGE`.  If no pixel
    is inner, all marked ones are."""
    height, width = mask.shape
    kind, inner, whole = np.empty((height, width), np.uint8), 0, (2 * band + 1) ** 2
    columns = np.zeros(width + 2 * band, np.uint8)  # marked in each, of the rows within the band
    count = np.empty(width, np.uint8)
    for y in range(-2 * band, height):
        entering, leaving = mask[min(max(y + band, 0), height - 1)], mask[max(y - band - 1, 0)]
        within = columns[band : band + width]
        for x in range(width):
            within[x] += entering[x]
        if y > 0:
            for x in range(width):
                within[x] -= leaving[x]
        if y < 0:
            continue
        for k in range(band):
            columns[k], columns[band + width + k] = within[0], within[width - 1]
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
    """Add a row (w, 3) of pixels to the sums of the `columns` (w, 8), in place: red, green, blue and the number of the
    inner pixels, and the same of the outer ones."""
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
    """Shares a and b of two colours in a pixel's colour (least squares), the squared residual, and the squared
    difference of the two colours.

    A fourth channel, `UNIT` in all three, weighs the condition a + b = 1.
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
    """Sums over the covered pixels: direction times solid angle (3), and solid angle `omega`, sr; the upper half of the
    (4, 4) covariance of both, row by row, if pixel errors were independent; area, px; box (x, y, width, height) of the
    pixels that are covered by more than half."""

    direction: Color
    omega: float
    cov: Upper
    area: float
    box: tuple[int, int, int, int]


@njit(cache=True, error_model="numpy")
def moments(alpha: Map, variance: Map, weights: Map, left: int, top: int) -> Moments:
    """Moments of a region (h, w) of the image with its corner at `left`, `top`.

    Args:
        alpha, variance: (h, w) as from `covered`.
        weights: (4, height, width) each pixel's solid angle times its direction, and its solid angle.
    """
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
    return Moments(direction, omega, cov, area, (x0, y0, max(x1 - x0, 0), max(y1 - y0, 0)))


@njit(cache=True, error_model="numpy")
def harmonics(
    alpha: Map, weights: Map, left: int, top: int, axis: Color, omega: float
) -> tuple[tuple[float, float, float, float], float]:
    """Non-circularity of an outline: cosine and sine of the second and of the third harmonic of its edge, in shares of
    its radius, and the share by which its second moment exceeds a disc's.

    In the tangent plane of `axis`, the mean direction, in which a ball's image is a disc.  An edge at r(1 + ε cos kθ)
    has the moment ∫ρᵏ cos kθ dA = ε π r^(k + 2).

    Args:
        alpha, weights, left, top: As for `moments`.
        axis, omega: Direction and solid angle of its result.
    """
    p, q, r = axis
    length, side = math.sqrt(p * p + q * q + r * r), math.sqrt(p * p + r * r)
    p, q, r, ex, ez = p / length, q / length, r / length, r / side, -p / side  # e = (ex, 0, ez) is across the axis
    fx, fy, fz = q * ez, r * ex - p * ez, -q * ex
    c2 = s2 = c3 = s3 = spread = 0.0
    for row in range(len(alpha)):
        for column in range(alpha.shape[1]):
            if alpha[row, column] == 0:
                continue
            v, u = top + row, left + column
            a, b, c, d = weights[0, v, u], weights[1, v, u], weights[2, v, u], weights[3, v, u]
            x, y, w = (ex * a + ez * c) / d, (fx * a + fy * b + fz * c) / d, float(alpha[row, column]) * d
            xx, yy, xy = x * x, y * y, x * y
            c2, s2, spread = c2 + w * (xx - yy), s2 + 2 * w * xy, spread + w * (xx + yy)
            c3, s3 = c3 + w * x * (xx - 3 * yy), s3 + w * y * (3 * xx - yy)
    square = omega * omega / math.pi  # π r⁴
    cube = square * math.sqrt(omega / math.pi)
    return (c2 / square, s2 / square, c3 / cube, s3 / cube), 2 * spread / square - 1
