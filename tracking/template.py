"""Spatial template of an object: a correlation filter over places, and another one over scales.

    patch ─► cells: orientations of gradients, colours ─► response: where, and how large, the learned object is

The filter over places is confined to the object and changes slowly (Li et al., CVPR 2018, solved by two rounds of
ADMM); the one over scales is that of Danelljan et al., BMVC 2014; the cells are those of Felzenszwalb et al., PAMI
2010, without signed orientations.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pps_vision.jit import njit
from pps_vision.types import Array, Image

CELLS, CELL = 40, 4
"""Cells a side of a patch, and px of the patch a side of a cell."""
PADDING = 4.0
"""Side of the patch, in sizes √(width·height) of the object."""
N_CHANNELS, N_ORIENTATIONS = 12, 9
_LABEL = 1 / 16  # of the object's size: width of the wanted response
_ENERGY = 100.0  # mean power of a frequency of the cells, to which they are scaled
_TEMPORAL = 300.0  # weight of the filter's change; of 5, 15, 50, 150 and 500 the last two follow best (composite films)
_GAMMA, _GAMMA_GROWTH = 1.0, np.float32(10.0)  # weight of the confinement in the first round of ADMM, and its growth
_SCALES, _SCALE_STEP = 17, 1.035  # sizes tried, and their ratio
_SCALE_CELLS = 6  # a side
_SCALE_RATE = 0.03  # at which the filter over scales follows the newest image
_SCALE_FLOOR = 1e-2

Cells = NDArray[np.float32]
Map = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Shape = tuple[float, float]
"""Width and height of a box, in its sizes √(width·height)."""


class Sample(NamedTuple):
    """A square patch of an image (px, px, 3) and its cells (C, n, n)."""

    patch: Image
    cells: Cells


@dataclass(frozen=True, slots=True)
class Template:
    """The filter over places (C, n, n/2 + 1), the weights (n, n) by which two rounds confine it to the object, and
    numerator (C', k) and denominator (k,) of the filter over k scales."""

    places: Spectrum
    confinement: tuple[Map, Map]
    scale_top: NDArray[np.complex128]
    scale_bottom: Array


def sample(image: Image, center_px: Array, size_px: float) -> Sample:
    """The surroundings of a place, for an object of that size."""
    side = PADDING * size_px
    patch = _patch(image, center_px, (side, side), CELLS * CELL)
    return Sample(patch, cells(patch))


def learn(image: Image, center_px: Array, size_px: float, shape: Shape) -> Template:
    """The template of the object that fills a box of an image."""
    confinement = _confinement(shape)
    nothing = np.zeros((N_CHANNELS, CELLS, CELLS // 2 + 1), np.complex64)
    places = _solve(_spectrum(sample(image, center_px, size_px).cells), nothing, confinement, 0.0)
    seen = _scales(image, center_px, size_px, shape)
    return Template(places, confinement, _scale_label() * np.conj(seen), (np.abs(seen) ** 2).sum(axis=0))


def learn_places(template: Template, seen: Sample) -> Template:
    """The template after one more sample, with the object in its middle."""
    return replace(template, places=_solve(_spectrum(seen.cells), template.places, template.confinement, _TEMPORAL))


def learn_scales(template: Template, image: Image, center_px: Array, size_px: float, shape: Shape) -> Template:
    """The template after one more image of the object at that size."""
    seen, k = _scales(image, center_px, size_px, shape), _SCALE_RATE
    top = (1 - k) * template.scale_top + k * _scale_label() * np.conj(seen)
    return replace(template, scale_top=top, scale_bottom=(1 - k) * template.scale_bottom + k * (abs(seen) ** 2).sum(0))


def response(template: Template, seen: Sample) -> Map:
    """(n, n) how well the object fits where it is shifted by [row − n/2, column − n/2] cells from the middle."""
    found = fft.irfft2((template.places * _spectrum(seen.cells)).sum(axis=0), s=(CELLS, CELLS), norm="ortho")
    return np.asarray(np.fft.fftshift(found), dtype=np.float32)


def growth(template: Template, image: Image, center_px: Array, size_px: float, shape: Shape) -> float:
    """Ratio of the object's size to `size_px`."""
    seen = _scales(image, center_px, size_px, shape)
    fit = np.fft.ifft((template.scale_top * seen).sum(axis=0) / (template.scale_bottom + _SCALE_FLOOR)).real
    best = int(np.argmax(fit))
    return float(_SCALE_STEP ** (best + peak_offset(fit, best) - _SCALES // 2))


def peak_offset(values: Array, k: int) -> float:
    """−½ … ½: the vertex of the parabola through a largest value and its neighbours."""
    if not 0 < k < len(values) - 1:
        return 0.0
    a, b, c = float(values[k - 1]), float(values[k]), float(values[k + 1])
    bend = a - 2 * b + c
    return min(max(0.5 * (a - c) / bend, -0.5), 0.5) if bend < 0 else 0.0


def _spectrum(values: Cells) -> Spectrum:
    x = np.asarray(fft.rfft2(values * _window()), dtype=np.complex64)
    power = (x.real**2 + x.imag**2).sum(axis=0).mean()
    return np.asarray(x * np.float32(np.sqrt(_ENERGY / max(float(power), 1e-9))))


def _solve(x: Spectrum, before: Spectrum, confinement: tuple[Map, Map], temporal: float) -> Spectrum:
    """The filter with the wanted response to a sample, confined to the object and near the filter before.

    Each frequency is a linear system of rank one plus a multiple of the identity (Sherman–Morrison).
    """
    gamma, power = np.float32(_GAMMA), (x.real**2 + x.imag**2).sum(axis=0)
    turned = np.conj(x)
    fit, dual, confined = turned * _label() + np.float32(temporal) * before, np.zeros_like(x), np.zeros_like(x)
    for share in confinement:
        rho = gamma + np.float32(temporal)
        right = fit + gamma * (confined - dual)
        free = (right - turned * ((x * right).sum(axis=0) / (rho + power))) / rho
        inner = fft.irfft2(free + dual, s=(CELLS, CELLS), norm="ortho")
        confined = np.asarray(fft.rfft2(inner * share, norm="ortho"), np.complex64)
        dual = (dual + free - confined) / _GAMMA_GROWTH
        gamma *= _GAMMA_GROWTH
    return confined


@cache
def _window() -> Map:
    hann = np.hanning(CELLS + 2)[1:-1]
    return np.outer(hann, hann).astype(np.float32)


@cache
def _label() -> Spectrum:
    at = np.arange(CELLS) - CELLS // 2
    line = np.exp(-0.5 * (at / (_LABEL * CELLS / PADDING)) ** 2)
    return np.asarray(fft.rfft2(np.fft.ifftshift(np.outer(line, line)), norm="ortho"), dtype=np.complex64)


def _confinement(shape: Shape) -> tuple[Map, Map]:
    """(n, n) each round's share of the filter that remains; the penalty grows with the square of the distance from the
    object's middle.  The filter of a correlation is mirrored."""
    y, x = np.meshgrid(*(2 * cell_offsets() / side for side in shape[::-1]), indexing="ij")
    penalty = np.roll((1e-2 + x**2 + y**2)[::-1, ::-1], 1, axis=(0, 1))
    first, second = (gamma / (penalty**2 + gamma) for gamma in (_GAMMA, _GAMMA * float(_GAMMA_GROWTH)))
    return first.astype(np.float32), second.astype(np.float32)


@cache
def cell_offsets() -> Array:
    """(n,) of the cells' centres from the patch's, in sizes of the object."""
    return (np.arange(CELLS) - (CELLS - 1) / 2) * PADDING / CELLS


def _scales(image: Image, center_px: Array, size_px: float, shape: Shape) -> NDArray[np.complex128]:
    """(C', k) spectrum over scales of the object's cells."""
    factors = _SCALE_STEP ** (np.arange(_SCALES) - _SCALES // 2)
    rows = [
        cells(_patch(image, center_px, (size_px * f * shape[0], size_px * f * shape[1]), _SCALE_CELLS * CELL)).ravel()
        for f in factors.tolist()
    ]
    return np.asarray(np.fft.fft(np.array(rows).T * np.hanning(_SCALES + 2)[1:-1], axis=1))


@cache
def _scale_label() -> NDArray[np.complex128]:
    at = np.arange(_SCALES) - _SCALES // 2
    return np.asarray(np.fft.fft(np.exp(-0.5 * (at / (1.5 / 16 * _SCALES)) ** 2)))


def _patch(image: Image, center_px: Array, sides_px: tuple[float, float], out: int) -> Image:
    """(out, out, 3) the part of an image with that centre and those sides; beyond its border its edge goes on."""
    (cx, cy), (w, h) = center_px.tolist(), sides_px
    zoom = int(min(w, h) / out)
    if zoom > 1:  # averages, since interpolation alone would alias
        height, width = image.shape[:2]
        x0, x1 = (int(np.clip(x, 0, width)) for x in (cx - w / 2 - 2 * zoom, cx + w / 2 + 2 * zoom))
        y0, y1 = (int(np.clip(y, 0, height)) for y in (cy - h / 2 - 2 * zoom, cy + h / 2 + 2 * zoom))
        columns, rows = (x1 - x0) // zoom, (y1 - y0) // zoom
        if columns > 0 and rows > 0:
            crop = image[y0 : y0 + rows * zoom, x0 : x0 + columns * zoom]
            image = np.asarray(cv2.resize(crop, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
            cx, cy, w, h = (cx - x0 + 0.5) / zoom - 0.5, (cy - y0 + 0.5) / zoom - 0.5, w / zoom, h / zoom
    a, d = w / out, h / out
    M = np.array([[a, 0, cx - a * (out - 1) / 2], [0, d, cy - d * (out - 1) / 2]])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(image, M, (out, out), flags=how, borderMode=cv2.BORDER_REPLICATE), np.uint8)


@njit(cache=True, error_model="numpy", fastmath=True)
def cells(patch: Image) -> Cells:
    """(C, n, n) of a patch: nine orientations of its gradient, normalised by the energy around; then mean brightness,
    red − green and yellow − blue."""
    n = patch.shape[0] // CELL
    hist = np.zeros((n + 2, n + 2, N_ORIENTATIONS), np.float32)
    out = np.zeros((N_CHANNELS, n, n), np.float32)
    cosine, sine = np.empty(N_ORIENTATIONS, np.float32), np.empty(N_ORIENTATIONS, np.float32)
    for k in range(N_ORIENTATIONS):
        cosine[k], sine[k] = np.cos(k * np.pi / N_ORIENTATIONS), np.sin(k * np.pi / N_ORIENTATIONS)
    side = n * CELL
    for y in range(side):
        up, down = max(y - 1, 0), min(y + 1, side - 1)
        fy = (y + 0.5) / CELL + 0.5
        iy = int(fy)
        wy = np.float32(fy - iy)
        for x in range(side):
            left, right = max(x - 1, 0), min(x + 1, side - 1)
            most, gx, gy = np.float32(-1.0), np.float32(0.0), np.float32(0.0)
            for c in range(3):
                dx = np.float32(patch[y, right, c]) - np.float32(patch[y, left, c])
                dy = np.float32(patch[down, x, c]) - np.float32(patch[up, x, c])
                m = dx * dx + dy * dy
                if m > most:
                    most, gx, gy = m, dx, dy
            best, which = np.float32(-1.0), 0
            for k in range(N_ORIENTATIONS):
                dot = abs(gx * cosine[k] + gy * sine[k])
                if dot > best:
                    best, which = dot, k
            size = np.sqrt(most)
            fx = (x + 0.5) / CELL + 0.5
            ix = int(fx)
            wx = np.float32(fx - ix)
            hist[iy, ix, which] += size * (1 - wy) * (1 - wx)
            hist[iy, ix + 1, which] += size * (1 - wy) * wx
            hist[iy + 1, ix, which] += size * wy * (1 - wx)
            hist[iy + 1, ix + 1, which] += size * wy * wx
            r, g, b = np.float32(patch[y, x, 0]), np.float32(patch[y, x, 1]), np.float32(patch[y, x, 2])
            cy, cx = y // CELL, x // CELL
            out[9, cy, cx] += (r + g + b) / 3
            out[10, cy, cx] += r - g
            out[11, cy, cx] += 0.5 * (r + g) - b
    energy = np.zeros((n + 2, n + 2), np.float32)
    for y in range(n + 2):
        for x in range(n + 2):
            for k in range(N_ORIENTATIONS):
                energy[y, x] += hist[y, x, k] ** 2
    for y in range(1, n + 1):
        for x in range(1, n + 1):
            for by in range(2):
                for bx in range(2):
                    p, q = y - 1 + by, x - 1 + bx
                    block = energy[p, q] + energy[p, q + 1] + energy[p + 1, q] + energy[p + 1, q + 1]
                    inverse = 1 / np.sqrt(block + np.float32(100.0))
                    for k in range(N_ORIENTATIONS):
                        out[k, y - 1, x - 1] += np.float32(0.5) * min(hist[y, x, k] * inverse, np.float32(0.2))
    share = np.float32(1 / (CELL * CELL * 255))
    for y in range(n):
        for x in range(n):
            out[9, y, x] = (out[9, y, x] * share - np.float32(0.5)) * np.float32(0.5)
            out[10, y, x] *= share
            out[11, y, x] *= share
    return out
