"""The messages: their arrays cannot be changed, and do not share their flag with the sender's."""

import numpy as np
import pytest

from pps_vision.types import Activation, JointVelocity, Status, StereoFrame, Track3D


def test_arrays_of_a_message_are_read_only_and_the_senders_stays_writeable() -> None:
    sent = np.zeros(3)
    message = JointVelocity(0.0, sent, 0.5)
    with pytest.raises(ValueError, match="read-only"):
        message.dq_rad_s[0] = 1.0
    sent[0] = 1.0
    assert sent.flags.writeable


def test_every_array_of_a_message_is_read_only_and_none_stays() -> None:
    image = np.zeros((2, 2, 3), np.uint8)
    frame = StereoFrame(image, image, 0.0, 0.0, np.zeros(2))
    messages = [frame, Track3D.unknown(0.0, Status.LOST), Activation(0.0, ("a:1",), np.zeros(1))]
    arrays = [getattr(message, name) for message in messages for name in type(message).__slots__]
    arrays = [array for array in arrays if isinstance(array, np.ndarray)]
    assert len(arrays) == 6
    assert not any(array.flags.writeable for array in arrays)
    assert frame.joints_right_rad is None
