"""What is really there: the answer every estimate is measured against."""

from dataclasses import dataclass

from pps_vision.types import Array


@dataclass(frozen=True, slots=True)
class Truth:
    """The stimulus at one stamp, root frame, and where its centre appears in each image.

    `position` m, `velocity` m/s (3,); `left_px`, `right_px` (2,) the projection of the centre,
    lens distortion included, NaN behind an eye; visible means that the centre projects into
    the image and that nothing stands before it but the stimulus itself.
    """

    stamp_s: float
    position: Array
    velocity: Array
    radius_m: float
    left_px: Array
    right_px: Array
    visible_left: bool
    visible_right: bool
