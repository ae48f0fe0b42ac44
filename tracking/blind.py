"""Eyes that show nothing, or nothing new: a camera that is dark, or a driver that repeats its last image.

Real robots were seen to spin their heads on a frozen image under new stamps: every stamp moves the eyes on,
and what rests in the image goes through the world with them.  Such an image is no observation.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from pps_vision.types import Image, StereoFrame

_STRIDE = 40  # between the rows that are looked at first: where they differ, nothing is repeated
_LEAST_SPREAD = 2.0  # grey levels (a standard deviation): a dark sensor's noise has less, any picture more


class Blindness:
    """Tells of each pair whether one of its eyes is blind; remembers the last pair."""

    def __init__(self) -> None:
        self._last: tuple[_Seen, _Seen] | None = None

    def step(self, frame: StereoFrame) -> bool:
        """Whether either eye shows what it showed before, to the last bit, or nothing at all."""
        before = self._last
        self._last = now = _Seen(frame.left, _sums(frame.left)), _Seen(frame.right, _sums(frame.right))
        if before is not None and (now[0].is_again(before[0]) or now[1].is_again(before[1])):
            return True
        return now[0].is_dark or now[1].is_dark


Sums = tuple[float, float, float, float, float, float, float]


class _Seen(NamedTuple):
    """An image, and what some of its rows added up to: a camera's driver may fill the same image anew."""

    image: Image
    sums: Sums

    @property
    def is_dark(self) -> bool:
        """Whether nothing stands out in any colour."""
        n, *of = self.sums
        colors = zip(of[:3], of[3:], strict=True)
        return all(n * squares - total**2 < (n * _LEAST_SPREAD) ** 2 for total, squares in colors)

    def is_again(self, before: "_Seen") -> bool:
        """Whether all of it is the same; without noise what moves may do so between the rows."""
        return self.sums == before.sums and np.array_equal(self.image, before.image)


@njit(cache=True, error_model="numpy")
def _sums(image: Image) -> Sums:
    """Of some rows: the number of their pixels, and their red, green and blue and the squares of these added up."""
    a = b = c = d = e = f = n = 0.0
    for y in range(0, len(image), _STRIDE):
        row = image[y]
        for x in range(len(row)):
            red, green, blue = float(row[x, 0]), float(row[x, 1]), float(row[x, 2])
            a, b, c = a + red, b + green, c + blue
            d, e, f = d + red * red, e + green * green, f + blue * blue
        n += len(row)
    return n, a, b, c, d, e, f
