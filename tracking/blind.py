"""Eyes that show nothing, or nothing new: a camera that is dark, or a driver that repeats its last image.

Real robots were seen to spin their heads on a frozen image under new stamps: every stamp moves the eyes on,
and what rests in the image goes through the world with them.  Such an image is no observation.
"""

import numpy as np

from pps_vision.types import Image, StereoFrame

_STRIDE = 12  # between the rows that are looked at: thousands of pixels, of which no sensor repeats every bit
_LEAST_SPREAD = 2.0  # grey levels (a standard deviation): a dark sensor's noise has less, any picture more


class Blindness:
    """Tells of each pair whether one of its eyes is blind; remembers some of the last pixels."""

    def __init__(self) -> None:
        self._last: tuple[Image, Image] | None = None

    def step(self, frame: StereoFrame) -> bool:
        """Whether either eye shows what it showed before, to the last bit, or nothing at all."""
        before, now = self._last, (_some(frame.left), _some(frame.right))
        self._last = now
        repeated = before is not None and any(np.array_equal(a, b) for a, b in zip(before, now, strict=True))
        return repeated or any(float(image[:, ::4, 1].std()) < _LEAST_SPREAD for image in now)


def _some(image: Image) -> Image:
    return image[::_STRIDE].copy()
