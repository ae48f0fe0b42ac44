"""Checks of a stereo frame before it is tracked: is it well-formed, does it show anything, is it new?

Some camera drivers repeat their last image under new stamps.  With a moving head, an object that rests in the image
would then move through the world.  Such an image is no observation.
"""

from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.jit import njit
from pps_vision.types import Array, Image, StereoFrame

_STRIDE = 40  # every such row is compared first: images that differ there are not the same
_DARK_STD = 2.0  # grey levels: the noise of a dark sensor has less, most pictures more
_BLACK = 16.0  # grey levels: black of ITU-R BT.601
_HOT_PX = 5  # width of a median that removes single hot pixels, which demosaicing spreads over 3×3

Stamps = tuple[float, float]


def check(frame: StereoFrame, rig: StereoRig, last_s: Stamps) -> None:
    """InputError for stamps that are not after the last ones, or images that are not the rig's cameras'."""
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
    """An image, and sums over some of its rows: a driver may fill the same buffer anew."""

    image: Image
    sums: Sums

    @classmethod
    def of(cls, image: Image) -> "Fingerprint":
        """That of an RGB image."""
        return cls(image, _sums(image, _STRIDE))

    @property
    def is_blank(self) -> bool:
        """Whether the image is black but for the noise and single hot pixels of a dark sensor, or all its pixels are
        equal.

        A plain wall in the light has as little contrast, but it is brighter, and the sensor's noise is on it.
        """
        if not (_is_black(self.sums) or _is_plain(self.sums)):  # a few rows tell most images
            return False
        every = _sums(self.image, 1)
        if _is_plain(every) or not _is_black(every):
            return _is_plain(every)
        return _is_even(_sums(np.asarray(cv2.medianBlur(self.image, _HOT_PX), dtype=np.uint8), 1))

    def repeats(self, before: "Fingerprint") -> bool:
        """Whether both images are the same to the last bit."""
        return self.sums == before.sums and np.array_equal(self.image, before.image)


Fingerprints = tuple[Fingerprint, Fingerprint]  # left, right


def fingerprints(frame: StereoFrame) -> Fingerprints:
    """Those of both images."""
    return Fingerprint.of(frame.left), Fingerprint.of(frame.right)


def is_blind(now: Fingerprints, before: Fingerprints | None) -> bool:
    """Whether either eye shows nothing, or what it showed in the frame before."""
    if before is not None and (now[0].repeats(before[0]) or now[1].repeats(before[1])):
        return True
    return now[0].is_blank or now[1].is_blank


def _is_black(sums: Sums) -> bool:
    """Whether the pixels behind these sums are black in the mean."""
    return all(total < sums[0] * _BLACK for total in sums[1:4])


def _is_even(sums: Sums) -> bool:
    """Whether they differ by no more than the noise of a dark sensor."""
    return bool((_variances(sums) < _DARK_STD**2).all())


def _is_plain(sums: Sums) -> bool:
    """Whether they are all equal."""
    return not _variances(sums).any()


def _variances(sums: Sums) -> Array:
    n, *of = sums
    return (n * np.array(of[3:]) - np.array(of[:3]) ** 2) / n**2


@njit(cache=True, error_model="numpy")
def _sums(image: Image, stride: int) -> Sums:
    """Over every `stride`-th row: number of pixels, sums of red, green and blue, and sums of their squares."""
    a = b = c = d = e = f = n = 0.0
    for y in range(0, len(image), stride):
        row = image[y]
        for x in range(len(row)):
            red, green, blue = float(row[x, 0]), float(row[x, 1]), float(row[x, 2])
            a, b, c = a + red, b + green, c + blue
            d, e, f = d + red * red, e + green * green, f + blue * blue
        n += len(row)
    return n, a, b, c, d, e, f
