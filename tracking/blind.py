"""Eyes that show nothing, or nothing new: a camera that is dark, or a driver that repeats its last image.

Real robots were seen to spin their heads on a frozen image under new stamps: every stamp moves the eyes on,
and what rests in the image goes through the world with them.  Such an image is no observation.
"""

from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.types import Image, StereoFrame

_STRIDE = 40  # between the rows that are looked at first: where they differ, nothing is repeated
_LEAST_SPREAD = 2.0  # grey levels (a standard deviation): a dark sensor's noise has less, any picture more


class Blindness:
    """Tells of each pair whether one of its eyes is blind; remembers the last pair, and some of its pixels."""

    def __init__(self) -> None:
        self._last: tuple[_Seen, _Seen] | None = None

    def step(self, frame: StereoFrame) -> bool:
        """Whether either eye shows what it showed before, to the last bit, or nothing at all."""
        before, self._last = self._last, (_Seen.of(frame.left), _Seen.of(frame.right))
        repeated = before is not None and any(map(_Seen.is_again, self._last, before))
        return repeated or any(_is_dark(image[::_STRIDE]) for image in (frame.left, frame.right))


class _Seen(NamedTuple):
    """An image, and some of its rows as they were: a camera's driver may fill the same image anew."""

    image: Image
    rows: bytes

    @classmethod
    def of(cls, image: Image) -> "_Seen":
        return cls(image, image[::_STRIDE].tobytes())

    def is_again(self, before: "_Seen") -> bool:
        """Whether all of it is the same; without noise what moves may do so between the rows."""
        return self.rows == before.rows and np.array_equal(self.image, before.image)


def _is_dark(rows: Image) -> bool:
    """Whether nothing stands out; where a quarter of the rows spread twice as much as the least, all do enough."""
    return _spread(rows[::4]) < 2 * _LEAST_SPREAD and _spread(rows) < _LEAST_SPREAD


def _spread(rows: Image) -> float:
    """The largest standard deviation of a colour, grey levels."""
    (red,), (green,), (blue,) = cv2.meanStdDev(rows)[1].tolist()
    return max(red, green, blue)
