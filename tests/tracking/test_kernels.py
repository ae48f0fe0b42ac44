"""Compiled coverage against the same in whole arrays of doubles: filters of SciPy, least squares of NumPy."""

import numpy as np
import pytest
from scipy import ndimage

from pps_vision.types import Array, Image, Mask
from tracking.outline import LEVELS, UNIT, covered


def _textbook(image: Image, mask: Mask, band: int) -> tuple[Array, Array]:
    """Coverage and its variance as `covered` says it has them."""
    near = 2 * band + 1
    square = np.ones((4 * band + 5,) * 2)
    inner = ndimage.minimum_filter(mask, near, mode="nearest")
    outer = ~ndimage.maximum_filter(mask, near, mode="nearest")
    inner = inner if inner.any() else mask
    layers = []
    edge = ~(inner | outer)
    bound = np.full((*mask.shape, 1), UNIT)
    for where in (inner, outer):
        colors = np.where(where[..., None], image, 0.0)
        count = np.maximum(where.sum(), 1)
        sums = np.stack([ndimage.convolve(colors[..., k], square, mode="constant") for k in range(3)], axis=-1)
        counts = ndimage.convolve(where.astype(float), square, mode="constant")[..., None]
        mean = np.where(counts > 0, sums / np.maximum(counts, 1), colors.sum(axis=(0, 1)) / count)
        layers.append(np.concatenate([mean, bound], axis=-1)[edge])
    mixed = np.concatenate([image, bound], axis=-1)[edge]
    F, B = layers
    alpha = inner.astype(float)
    variance = np.zeros(mask.shape)
    shares = np.array([np.linalg.lstsq(np.stack([f, b], axis=1), i)[0] for f, b, i in zip(F, B, mixed, strict=True)])
    a, b = np.maximum(shares.reshape(-1, 2).T, 0)
    remainder = (mixed - a[:, None] * F - b[:, None] * B)[:, :3]
    mixed_precision = np.sum((F - B) ** 2, axis=1) / (np.mean(remainder**2, axis=1) + 1)
    variance[edge] = 1 / (mixed_precision + 12)
    alpha[edge] = variance[edge] * (mixed_precision * a / np.maximum(a + b, 1e-6) + 12 * mask[edge])
    return alpha, variance


def _scene(kind: str, rng: np.random.Generator) -> tuple[Image, Mask]:
    v, u = np.mgrid[:31, :38]
    mask = {
        "disc": np.hypot(v - 15, u - 17) < 8,
        "at the border": np.hypot(v - 2, u - 36) < 8,
        "thin": (abs(v - 15) < 1) & (u > 9),
        "two": (np.hypot(v - 9, u - 9) < 5) | (np.hypot(v - 20, u - 26) < 7),
        "far apart": (np.hypot(v - 9, u - 9) < 6) | ((v == 28) & (u == 35)),
        "all but a hole": np.hypot(v - 15, u - 17) > 3,
    }[kind]
    image = np.where(mask[..., None], (25, 200, 60), (90, 80, 70)) + rng.normal(0, 9, (*mask.shape, 3))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), mask


KINDS = ("disc", "at the border", "thin", "two", "far apart", "all but a hole")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("band", [1, 2])
def test_coverage_is_the_textbooks(kind, band, rng):
    image, mask = _scene(kind, rng)
    alpha, variance, _ = covered(image, mask, band, LEVELS)
    true_alpha, true_variance = _textbook(image, mask, band)
    assert 0 < np.count_nonzero(variance) < mask.size
    np.testing.assert_allclose(alpha, true_alpha, atol=1e-6)
    np.testing.assert_allclose(variance, true_variance, rtol=1e-6)
