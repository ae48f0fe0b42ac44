"""Checks of a stereo frame before it is tracked: well-formed, not blank, not repeated.

Some camera drivers repeat their last image under new stamps.  While the head moves, an object that rests in the image
would then move through the world, so a repeated image is no observation.
"""

from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.types import Array, Image, StereoFrame

_STRIDE = 40  # distance of the rows that are compared first
_DARK_STD = 2.0  # grey levels: the noise of a dark sensor is lower, the contrast of most images higher
_BLACK = 16.0  # grey levels: black of ITU-R BT.601
_EQUAL_STD = 1e-3  # grey levels: rounding
_HOT_PX = 5  # width of a median that removes single hot pixels, which demosaicing spreads over 3×3

Stamps = tuple[float, float]


def check(frame: StereoFrame, rig: StereoRig, last_s: Stamps) -> None:
    """Raise InputError for stamps that are not after the last ones, or images that do not fit the rig's cameras."""
    for name, new, old, image, camera in (
        ("left", frame.stamp_left_s, last_s[0], frame.left, rig.left),
        ("right", frame.stamp_right_s, last_s[1], frame.right, rig.right),
    ):
        if not old < new < np.inf:
            raise InputError("frame", f"{name} stamp {new:.6f} s after {old:.6f} s; expected rising stamps")
        expected = camera.height, camera.width, 3
        if image.shape != expected or image.dtype != np.uint8:
            raise InputError("frame", f"{name} image {image.shape} {image.dtype}; expected {expected} uint8")


class Fingerprint(NamedTuple):
    """An image, and mean and standard deviation (2, 3) of its colours in some rows (a driver may refill its buffer)."""

    image: Image
    levels: Array

    @classmethod
    def of(cls, image: Image) -> "Fingerprint":
        """Return the fingerprint of an RGB image."""
        return cls(image, _levels(image[::_STRIDE]))

    @property
    def is_blank(self) -> bool:
        """Whether the image is black except for noise and single hot pixels, or all its pixels are equal.

        A plain lit wall has as little contrast, but it is brighter and shows the sensor's noise.
        """
        if not (_is_black(self.levels) or _is_plain(self.levels)):  # a few rows tell most images
            return False
        levels = _levels(self.image)
        if _is_plain(levels) or not _is_black(levels):
            return _is_plain(levels)
        filtered = np.asarray(cv2.medianBlur(self.image, _HOT_PX), dtype=np.uint8)
        return bool((_levels(filtered)[1] < _DARK_STD).all())

    def repeats(self, previous: "Fingerprint") -> bool:
        """Whether both images are identical."""
        return np.array_equal(self.levels, previous.levels) and np.array_equal(self.image, previous.image)


Fingerprints = tuple[Fingerprint, Fingerprint]  # left, right


def fingerprints(frame: StereoFrame) -> Fingerprints:
    """Return the fingerprints of both images."""
    return Fingerprint.of(frame.left), Fingerprint.of(frame.right)


def is_blind(images: Fingerprints, previous: Fingerprints | None) -> bool:
    """Whether the image of either eye is blank or repeats the previous one."""
    if previous is not None and (images[0].repeats(previous[0]) or images[1].repeats(previous[1])):
        return True
    return images[0].is_blank or images[1].is_blank


def _levels(image: Image) -> Array:
    """(2, 3) mean and standard deviation of red, green and blue, grey levels."""
    return np.asarray(np.stack(cv2.meanStdDev(image))[..., 0], float)


def _is_black(levels: Array) -> bool:
    """Whether the mean of the pixels is black."""
    return bool((levels[0] < _BLACK).all())


def _is_plain(levels: Array) -> bool:
    """Whether all pixels are equal."""
    return bool((levels[1] < _EQUAL_STD).all())
