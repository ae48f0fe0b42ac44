"""Eyes that show nothing, or nothing new: a camera that is dark, or a driver that repeats its last image.

Real robots were seen to spin their heads on a frozen image under new stamps: every stamp moves the eyes on,
and what rests in the image goes through the world with them.  Such an image is no observation.
"""

import cv2

from pps_vision.types import Image, StereoFrame

_STRIDE = 24  # between the rows that are looked at: thousands of pixels, of which no sensor repeats every bit
_LEAST_SPREAD = 2.0  # grey levels (a standard deviation): a dark sensor's noise has less, any picture more


class Blindness:
    """Tells of each pair whether one of its eyes is blind; remembers some of the last pixels."""

    def __init__(self) -> None:
        self._last: tuple[bytes, bytes] | None = None

    def step(self, frame: StereoFrame) -> bool:
        """Whether either eye shows what it showed before, to the last bit, or nothing at all."""
        some = frame.left[::_STRIDE], frame.right[::_STRIDE]
        before, self._last = self._last, (some[0].tobytes(), some[1].tobytes())
        repeated = before is not None and (before[0] == self._last[0] or before[1] == self._last[1])
        return repeated or any(_is_dark(rows) for rows in some)


def _is_dark(rows: Image) -> bool:
    """Whether nothing stands out; where a quarter of the rows spread twice as much as the least, all do enough."""
    return _spread(rows[::4]) < 2 * _LEAST_SPREAD and _spread(rows) < _LEAST_SPREAD


def _spread(rows: Image) -> float:
    """The largest standard deviation of a colour, grey levels."""
    (red,), (green,), (blue,) = cv2.meanStdDev(rows)[1].tolist()
    return max(red, green, blue)
