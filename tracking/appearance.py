"""Appearance: the object's colour histogram against that of its surroundings, and the re-identification gate."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

N_BINS = 110  # 10 hues × 10 saturations, then 10 values for pixels without a colour (R's histogram)
_GREY_SATURATION = 40  # of 255; below it the hue is noise
_DARK_VALUE = 25  # the same
SEPARABLE = 0.8  # Bhattacharyya coefficient of object and surroundings up to which colours separate them
_SAME_SIMILARITY = 0.85  # least Bhattacharyya coefficient of the colours of one object before and after a gap
_SAME_RADIUS_RATIO = 1.25  # largest ratio of its radii
_NEVER_SEEN = 4e-3  # share of a histogram that a colour must have to count as seen


def all_colors(bits: int) -> Image:
    """(1, 2^(3·bits), 3) every RGB colour of that many bits a channel, the lower bits at half their range."""
    step = 1 << (8 - bits)
    level = np.arange(step // 2, 256, step, dtype=np.uint8)
    return np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(1, -1, 3)


@cache
def _bin_table() -> NDArray[np.uint8]:
    """(262144,) histogram bin of every colour R6G6B6; lower bits are mostly pixel noise."""
    h, s, v = cv2.split(cv2.cvtColor(all_colors(6), cv2.COLOR_RGB2HSV_FULL).astype(int))
    colored = 10 * (h * 10 // 256) + s * 10 // 256
    table: NDArray[np.uint8] = np.where((s < _GREY_SATURATION) | (v < _DARK_VALUE), 100 + v * 10 // 256, colored)
    return table.astype(np.uint8).ravel()


def color_bins(image: Image) -> NDArray[np.uint8]:
    """(h, w) histogram bin of every pixel of an RGB image (h, w, 3)."""
    return _looked_up(image, _bin_table())


@njit(cache=True, error_model="numpy")
def _looked_up(image: Image, table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) entry of the table (262144,) for every pixel's colour (h, w, 3)."""
    bins = np.empty(image.shape[:2], np.uint8)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            red = np.int32(image[y, x, 0])
            green = np.int32(image[y, x, 1])
            blue = np.int32(image[y, x, 2])
            bins[y, x] = table[(red >> 2 << 12) + (green >> 2 << 6) + (blue >> 2)]
    return bins


@njit(cache=True, error_model="numpy")
def histogram(bins: NDArray[np.uint8], where: Mask) -> Array:
    """(N_BINS,) normalised histogram of the pixels (h, w) of a mask (h, w); uniform if the mask is empty."""
    counts = np.zeros(N_BINS)
    for y in range(bins.shape[0]):
        for x in range(bins.shape[1]):
            if where[y, x]:
                counts[bins[y, x]] += 1
    total = counts.sum()
    return counts / total if total > 0 else np.full(N_BINS, 1 / N_BINS)


@dataclass(frozen=True)
class ColorModel:
    """Normalised histograms (N_BINS,) of the object and of its surroundings."""

    object: Array
    background: Array

    def table(self) -> NDArray[np.float32]:
        """(N_BINS,) probability that a pixel of each bin belongs to the object, prior ½; a colour seen in neither
        more likely belongs to the background."""
        return share(self.object, self.background)

    def shows(self, pixels: Image) -> Mask:
        """(h, w) whether pixels (h, w, 3) have colours of the object rather than of its surroundings."""
        return np.take(self.table() > 0.5, color_bins(pixels))

    def backdrop(self) -> Mask:
        """(N_BINS,) whether a colour is more frequent in the surroundings than in the object."""
        likely: Mask = self.background > self.object + _NEVER_SEEN
        return likely

    def similarity(self, histogram: Array) -> float:
        """Bhattacharyya coefficient of the object and another histogram, 0–1."""
        return float(np.sqrt(self.object * histogram).sum())

    def blend(self, newer: "ColorModel", object_rate: float, background_rate: float) -> "ColorModel":
        """This model moved towards a newer one."""
        return ColorModel(
            (1 - object_rate) * self.object + object_rate * newer.object,
            (1 - background_rate) * self.background + background_rate * newer.background,
        )


def share(own: Array, other: Array) -> NDArray[np.float32]:
    """(N_BINS,) share of `own` colours in both's; a colour in neither is rather one of the others."""
    return (own / (own + other + _NEVER_SEEN)).astype(np.float32)


def is_same_object(
    tracked: Sequence[ColorModel | None],
    radius_m: float,
    detected: Sequence[ColorModel | None],
    detected_radius_m: float,
) -> bool:
    """Re-identification gate: does a new detection show the object that was tracked before?

    Args:
        tracked: The object's colours in each eye, None where they are unknown.
        radius_m: Its radius.
        detected: The detection's colours in each eye.
        detected_radius_m: The detection's radius.
    """
    for model, candidate in zip(tracked, detected, strict=True):
        if model and candidate and model.similarity(candidate.object) < _SAME_SIMILARITY:
            return False
    ratio = detected_radius_m / radius_m
    return max(ratio, 1 / ratio) <= _SAME_RADIUS_RATIO
