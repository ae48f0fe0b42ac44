"""The spatial template against slow references: cells by their definition, the filter by dense linear systems."""

import cv2
import numpy as np
import pytest

from pps_vision.types import Array, Image
from tracking import template
from tracking.template import CELL, CELLS, N_ORIENTATIONS, PADDING


def blobs(rng: np.random.Generator, height: int = 240, width: int = 320) -> Image:
    """(height, width, 3) coloured blobs of all sizes."""
    layers = [
        cv2.resize(rng.normal(0, 25, (height // k, width // k, 3)), (width, height), interpolation=cv2.INTER_CUBIC)
        for k in (5, 10, 20, 40)
    ]
    return np.clip(128 + np.sum(layers, axis=0), 0, 255).astype(np.uint8)


def cells_slowly(patch: Image) -> Array:
    """Histograms of gradient orientations (Felzenszwalb et al., PAMI 2010, unsigned only), then mean colours.

    Each pixel votes with its gradient for the nearest orientation of the four nearest cells, bilinearly; a cell is
    normalised by the energy (and 10 grey levels) of the four blocks of 2×2 cells it belongs to, and cut at 0.2.
    """
    n = len(patch) // CELL
    p = np.pad(patch.astype(float), ((1, 1), (1, 1), (0, 0)), mode="edge")
    dx, dy = p[1:-1, 2:] - p[1:-1, :-2], p[2:, 1:-1] - p[:-2, 1:-1]
    strongest = (dx**2 + dy**2).argmax(axis=2)[..., None]
    gx, gy = (np.take_along_axis(g, strongest, axis=2)[..., 0] for g in (dx, dy))
    turn = np.arange(N_ORIENTATIONS) * np.pi / N_ORIENTATIONS
    vote = np.abs(gx[..., None] * np.cos(turn) + gy[..., None] * np.sin(turn)).argmax(axis=2)
    centers = CELL * (np.arange(-1, n + 1) + 0.5) - 0.5  # of the cells and of one beyond each border, px
    near = np.clip(1 - np.abs(np.arange(n * CELL) - centers[:, None]) / CELL, 0, None)
    hist = np.stack([near @ (np.hypot(gx, gy) * (vote == k)) @ near.T for k in range(N_ORIENTATIONS)], axis=-1)
    energy = (hist**2).sum(axis=-1)
    blocks = energy[:-1, :-1] + energy[1:, :-1] + energy[:-1, 1:] + energy[1:, 1:]
    length = np.sqrt(blocks + 100.0)[..., None]
    inner = hist[1:-1, 1:-1]
    normalised = [inner / length[i : i + n, j : j + n] for i in (0, 1) for j in (0, 1)]
    gradients = 0.5 * np.minimum(normalised, 0.2).sum(axis=0)
    r, g, b = np.moveaxis(patch.reshape(n, CELL, n, CELL, 3).mean(axis=(1, 3)) / 255, -1, 0)
    return np.stack([*np.moveaxis(gradients, -1, 0), ((r + g + b) / 3 - 0.5) / 2, r - g, (r + g) / 2 - b])


def spectrum(cells: Array) -> Array:
    """Fourier transform of windowed cells, scaled to a mean power of 100."""
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(1, CELLS + 1) / (CELLS + 1))
    x = np.fft.rfft2(cells * np.outer(hann, hann))
    return np.asarray(x * np.sqrt(100 / (np.abs(x) ** 2).sum(axis=0).mean()))


def places_slowly(x: Array, before: Array, shape: tuple[float, float], temporal: float) -> Array:
    """Two rounds of ADMM (Li et al., CVPR 2018, algorithm 1) for the filter f that minimises

    ‖Σ x f − y‖² + temporal·‖f − before‖² + ‖penalty·f‖² (the last in space), each step by dense least squares.
    """
    away = np.minimum(np.arange(CELLS), CELLS - np.arange(CELLS))  # of a cell from the first, around the border
    line = np.exp(-0.5 * (away / (CELLS / PADDING / 16)) ** 2)  # width: a 16th of the object's size
    y = np.fft.rfft2(np.outer(line, line), norm="ortho")
    tap = (-np.arange(CELLS)) % CELLS  # the cell that each weight of the filter multiplies at no shift
    offset = (tap - (CELLS - 1) / 2) * PADDING / CELLS  # from the object's middle, in sizes of the object
    width, height = shape
    penalty = 0.01 + (2 * offset[:, None] / height) ** 2 + (2 * offset[None, :] / width) ** 2
    n, eye = len(x), np.eye(len(x))
    rows, confined, dual, gamma = x.reshape(n, -1), np.zeros_like(x), np.zeros_like(x), 1.0
    for _ in range(2):
        near = (confined - dual).reshape(n, -1)
        free = np.empty_like(rows)
        for k in range(rows.shape[1]):
            A = np.vstack([rows[None, :, k], np.sqrt(temporal) * eye, np.sqrt(gamma) * eye])
            b = np.concatenate(
                [y.ravel()[k : k + 1], np.sqrt(temporal) * before.reshape(n, -1)[:, k], np.sqrt(gamma) * near[:, k]]
            )
            free[:, k] = np.linalg.lstsq(A, b, rcond=None)[0]
        wanted = free.reshape(x.shape) + dual
        # the least of (penalty·g)² + γ·(g − wanted)² in each place
        in_space = gamma / (penalty**2 + gamma) * np.fft.irfft2(wanted, s=(CELLS, CELLS), norm="ortho")
        confined = np.fft.rfft2(in_space, norm="ortho")
        dual, gamma = (wanted - confined) / 10, 10 * gamma  # a scaled dual shrinks as its penalty grows
    return confined


def test_cells_are_what_their_definition_gives(rng: np.random.Generator) -> None:
    for patch in (blobs(rng, 160, 160), blobs(rng)[:24, :24], rng.integers(0, 256, (32, 32, 3), np.uint8)):
        np.testing.assert_allclose(template.cells(patch), cells_slowly(patch), atol=2e-5)


def test_cells_of_a_plain_patch_tell_its_colour_only() -> None:
    found = template.cells(np.full((24, 24, 3), (255, 51, 102), np.uint8))
    assert not found[:N_ORIENTATIONS].any()
    for channel, value in zip(found[N_ORIENTATIONS:], ((1.6 / 3 - 0.5) / 2, 0.8, 0.6 - 0.4), strict=True):
        np.testing.assert_allclose(channel, value, atol=1e-6)


@pytest.mark.parametrize("shape", [(1.0, 1.0), (1.5, 1 / 1.5)])
def test_the_filter_is_that_of_dense_linear_systems(shape: tuple[float, float], rng: np.random.Generator) -> None:
    first, second = blobs(rng), blobs(rng)
    at, size = np.array([150.0, 110.0]), 40.0
    learned = template.learn(first, at, size, shape)
    x = spectrum(template.sample(first, at, size).cells)
    expected = places_slowly(x, np.zeros_like(x), shape, 0.0)
    close = 2e-3 * np.abs(expected).max()  # single precision
    np.testing.assert_allclose(learned.places, expected, atol=close)
    seen = template.sample(second, at, size)
    expected = places_slowly(spectrum(seen.cells), np.asarray(learned.places, complex), shape, 300.0)
    np.testing.assert_allclose(template.learn_places(learned, seen).places, expected, atol=close)


@pytest.mark.parametrize("shift", [(0, 0), (3, 0), (0, -2), (-4, 5)])
def test_the_response_is_highest_at_the_objects_shift(shift: tuple[int, int], rng: np.random.Generator) -> None:
    """The object's place is `shift` cells (right, down) from where it is searched."""
    image, at, size = blobs(rng), np.array([160.0, 120.0]), 40.0
    learned = template.learn(image, at, size, (1.0, 1.0))
    cell_px = PADDING * size / CELLS
    fit = template.response(learned, template.sample(image, at - cell_px * np.array(shift), size))
    row, column = np.unravel_index(fit.argmax(), fit.shape)
    assert (column - CELLS // 2, row - CELLS // 2) == shift
    assert 0.3 < fit.max() < 1.2


@pytest.mark.parametrize("ratio", [0.9, 0.97, 1.0, 1.04, 1.12])
def test_growth_is_the_ratio_of_sizes(ratio: float, rng: np.random.Generator) -> None:
    image, at, shape = blobs(rng), np.array([160.0, 120.0]), (1.2, 1 / 1.2)
    learned = template.learn(image, at, 60.0, shape)
    M = np.array([[ratio, 0, 160 * (1 - ratio)], [0, ratio, 120 * (1 - ratio)]])
    grown = np.asarray(cv2.warpAffine(image, M, (320, 240), borderMode=cv2.BORDER_REPLICATE), np.uint8)
    size = 60.0
    for _ in range(4):  # the window over scales draws the estimate towards 1
        step = template.growth(learned, grown, at, size, shape)
        assert abs(step * size / 60 - ratio) < max(0.7 * abs(size / 60 - ratio), 0.01)
        size *= step
    assert size / 60 == pytest.approx(ratio, rel=0.01)


def test_the_filter_over_scales_follows_slowly(rng: np.random.Generator) -> None:
    """Numerator and denominator move the same small share of the way to those of the newest image."""
    old, new = blobs(rng), blobs(rng)
    at, shape = np.array([160.0, 120.0]), (1.0, 1.0)
    before, of_new = template.learn(old, at, 60.0, shape), template.learn(new, at, 60.0, shape)
    after = template.learn_scales(before, new, at, 60.0, shape)
    np.testing.assert_allclose(after.scale_top, 0.97 * before.scale_top + 0.03 * of_new.scale_top)
    np.testing.assert_allclose(after.scale_bottom, 0.97 * before.scale_bottom + 0.03 * of_new.scale_bottom)
    assert np.array_equal(after.places, before.places)


@pytest.mark.parametrize("side", [20.0, 31.0, 61.5, 118.0])
def test_a_patch_shows_the_square_about_a_place(side: float) -> None:
    """Of an image whose colours are its coordinates; the patch is 1 to 6 times as fine or as coarse."""
    v, u = np.mgrid[:200, :240].astype(float)
    image = np.stack([u, v, 0 * u], axis=-1).astype(np.uint8)
    patch = template._patch(image, np.array([120.5, 98.25]), (side, 1.2 * side), 20).astype(float)
    offsets = (np.arange(20) - 9.5) / 20
    np.testing.assert_allclose(patch[..., 0], np.broadcast_to(120.5 + side * offsets, (20, 20)), atol=1.01)
    np.testing.assert_allclose(patch[..., 1], np.broadcast_to(98.25 + 1.2 * side * offsets, (20, 20)).T, atol=1.01)
    assert abs((patch[..., 0] - (120.5 + side * offsets)).mean()) < 0.3 + 0.25  # levels are rounded, possibly down
    assert abs((patch[..., 1].T - (98.25 + 1.2 * side * offsets)).mean()) < 0.3 + 0.25


@pytest.mark.parametrize("side", [30.0, 90.0])
def test_beyond_the_border_a_patch_repeats_the_edge(side: float) -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[:, :4], image[:, -4:], image[:4, 8:-8], image[-4:, 8:-8] = 50, 100, 150, 200
    for place, value in (((-side, 30.0), 50), ((80 + side, 30.0), 100), ((40.0, -side), 150), ((40.0, 60 + side), 200)):
        patch = template._patch(image, np.array(place), (side, side), 20)
        assert patch[10, 10].tolist() == [value] * 3


def test_the_peak_of_a_parabola_is_its_vertex() -> None:
    x = np.arange(9.0)
    for vertex in (3.6, 4.0, 4.3):
        values = 5 - (x - vertex) ** 2
        assert template.peak_offset(values, 4) == pytest.approx(vertex - 4)
    assert template.peak_offset(np.array([3.0, 2.0, 1.0]), 0) == 0
    assert template.peak_offset(np.array([1.0, 2.0, 3.0]), 2) == 0
    assert template.peak_offset(np.array([1.0, 1.0, 1.0]), 1) == 0
    assert template.peak_offset(np.array([0.0, 1.0, 1.9]), 1) == 0.5
