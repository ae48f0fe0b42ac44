"""One eye's share of a stereo frame."""

from typing import NamedTuple

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array, Image, StereoFrame


class Look(NamedTuple):
    """What one eye saw, from where and when, and the robot's joints then (None: no robot)."""

    image: Image
    view: View
    stamp_s: float
    joints_rad: Array | None


Looks = tuple[Look, Look]  # left, right


def looks_of(frame: StereoFrame, view: StereoView) -> Looks:
    """Both eyes' shares of a frame seen from `view`."""
    return (
        Look(frame.left, view.left, frame.stamp_left_s, frame.joints_left_rad),
        Look(frame.right, view.right, frame.stamp_right_s, frame.joints_right_rad),
    )


def is_grey(image: Image) -> bool:
    """Whether an RGB image carries no colour at all."""
    few = image[::16, ::16]
    return bool((few[..., 1:] == few[..., :1]).all())
