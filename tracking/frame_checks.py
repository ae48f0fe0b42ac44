"""Checks of a stereo frame before it is tracked: well-formed, not blank, not repeated.

Some camera drivers repeat their last image under new stamps.  While the head moves, an object that rests in the image
would then move through the world, so a repeated image is no observation.
"""

from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.types import Image, StereoFrame

_STRIDE = 40  # distance of the rows that are compared first
_DARK_STD = 2.0  # grey levels: the noise of a dark sensor is lower, the contrast of most images higher
_BLACK = 16.0  # grey levels: black of ITU-R BT.601
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
    """An image, and a copy of some of its rows (a driver may refill its buffer)."""

    image: Image
    rows: Image

    @property
    def is_blank(self) -> bool:
        """Whether the image is black except for noise and single hot pixels, or all its pixels are equal.

        A plain lit wall has as little contrast, but it is brighter and shows the sensor's noise.  The rows tell most
        images.
        """
        if _is_plain(self.rows) and _is_plain(self.image):
            return True
        if not (_is_black(self.rows) and _is_black(self.image)):
            return False
        return bool((cv2.meanStdDev(cv2.medianBlur(self.image, _HOT_PX))[1] < _DARK_STD).all())

    def repeats(self, previous: "Fingerprint") -> bool:
        """Whether both images are identical."""
        return np.array_equal(self.rows, previous.rows) and np.array_equal(self.image, previous.image)


Fingerprints = tuple[Fingerprint, Fingerprint]  # left, right


def fingerprints(frame: StereoFrame) -> Fingerprints:
    """Return the fingerprints of both images."""
    left, right = (Fingerprint(image, image[::_STRIDE].copy()) for image in (frame.left, frame.right))
    return left, right


def is_blind(images: Fingerprints, previous: Fingerprints | None) -> bool:
    """Whether the image of either eye is blank or repeats the previous one."""
    if previous is not None and (images[0].repeats(previous[0]) or images[1].repeats(previous[1])):
        return True
    return images[0].is_blank or images[1].is_blank


def _is_black(image: Image) -> bool:
    """Whether the mean of the pixels is black."""
    return max(cv2.mean(image)) < _BLACK


def _is_plain(image: Image) -> bool:
    """Whether all pixels are equal."""
    return np.array_equal(image[0, 0], image[-1, -1]) and bool((image == image[0, 0]).all())
