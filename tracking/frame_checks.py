"""Checks of a stereo frame before it is tracked: well-formed, not blank, not repeated.

Some camera drivers repeat their last image under new stamps.  While the head moves, an object that rests in the image
would then move through the world, so a repeated image is no observation.
"""

from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.jit import njit
from pps_vision.types import Array, Image, StereoFrame

_STRIDE = 40  # distance of the rows that are compared first
_DARK_STD = 2.0  # grey levels: the noise of a dark sensor is lower, the contrast of most images higher
_BLACK = 16.0  # grey levels: black of ITU-R BT.601
_HOT_PX = 5  # width of a median that removes single hot pixels, which demosaicing spreads over 3×3

Stamps = tuple[float, float]


def check(frame: StereoFrame, rig: StereoRig, last_s: Stamps) -> None:
    """Raise InputError for stamps that are not after the last ones, or images that do not fit the rig's cameras."""
    eyes = (
        ("left", frame.stamp_left_s, last_s[0], frame.left, rig.left),
        ("right", frame.stamp_right_s, last_s[1], frame.right, rig.right),
    )
    for name, new, old, image, camera in eyes:
        if not old < new < np.inf:
            raise InputError("frame", f"{name} stamp {new:.6f} s after {old:.6f} s; expected rising stamps")
        expected = camera.height, camera.width, 3
        if image.shape != expected or image.dtype != np.uint8:
            raise InputError("frame", f"{name} image {image.shape} {image.dtype}; expected {expected} uint8")


Sums = tuple[float, float, float, float, float, float, float]


class Fingerprint(NamedTuple):
    """An image, and sums over some of its rows (a driver may refill the same buffer)."""

    image: Image
    sums: Sums

    @classmethod
    def of(cls, image: Image) -> "Fingerprint":
        """Return the fingerprint of an RGB image."""
        return cls(image, _sums(image, _STRIDE))

    @property
    def is_blank(self) -> bool:
        """Whether the image is black except for noise and single hot pixels, or all its pixels are equal.

        A plain lit wall has as little contrast, but it is brighter and shows the sensor's noise.
        """
        if not (_is_black(self.sums) or _is_plain(self.sums)):  # a few rows tell most images
            return False
        sums = _sums(self.image, 1)
        if _is_plain(sums) or not _is_black(sums):
            return _is_plain(sums)
        filtered = np.asarray(cv2.medianBlur(self.image, _HOT_PX), dtype=np.uint8)
        return bool((_variances(_sums(filtered, 1)) < _DARK_STD**2).all())

    def repeats(self, previous: "Fingerprint") -> bool:
        """Whether both images are identical."""
        return self.sums == previous.sums and np.array_equal(self.image, previous.image)


Fingerprints = tuple[Fingerprint, Fingerprint]  # left, right


def fingerprints(frame: StereoFrame) -> Fingerprints:
    """Return the fingerprints of both images."""
    return Fingerprint.of(frame.left), Fingerprint.of(frame.right)


def is_blind(images: Fingerprints, previous: Fingerprints | None) -> bool:
    """Whether the image of either eye is blank or repeats the previous one."""
    if previous is not None and (images[0].repeats(previous[0]) or images[1].repeats(previous[1])):
        return True
    return images[0].is_blank or images[1].is_blank


def _is_black(sums: Sums) -> bool:
    """Whether the mean of the pixels is black."""
    return all(total < sums[0] * _BLACK for total in sums[1:4])


def _is_plain(sums: Sums) -> bool:
    """Whether all pixels are equal."""
    return not _variances(sums).any()


def _variances(sums: Sums) -> Array:
    n = sums[0]
    return (n * np.array(sums[4:]) - np.array(sums[1:4]) ** 2) / n**2


@njit(cache=True, error_model="numpy")
def _sums(image: Image, stride: int) -> Sums:
    """Number of pixels of every `stride`-th row, sums of red, green and blue, and sums of their squares."""
    a = b = c = d = e = f = n = 0.0
    for y in range(0, len(image), stride):
        row = image[y]
        for x in range(len(row)):
            red = float(row[x, 0])
            green = float(row[x, 1])
            blue = float(row[x, 2])
            a += red
            b += green
            c += blue
            d += red * red
            e += green * green
            f += blue * blue
        n += len(row)
    return n, a, b, c, d, e, f
