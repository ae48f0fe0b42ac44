"""The messages: their arrays cannot be changed, and do not share their flag with the sender's."""

from dataclasses import FrozenInstanceError, fields, is_dataclass

import numpy as np
import pytest

from pps_vision import types
from pps_vision.types import (
    Activation,
    Detection2D,
    JointVelocity,
    Observation3D,
    Reachability,
    ReachStatus,
    Status,
    StereoFrame,
    TaxelEvents,
    Track3D,
    Truth,
)

ZERO = np.zeros(3)
MESSAGES = [
    StereoFrame(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2, 3), np.uint8), 1.0, 1.5, ZERO, ZERO),
    Detection2D(0.0, "left", np.zeros(2), np.eye(2), 0.5, 0.1, (0, 0, 1, 1)),
    Truth(0.0, ZERO, ZERO, 0.03, np.zeros(2), np.zeros(2), True, True),
    Observation3D(0.0, ZERO, np.eye(3), 0.03, 1e-6, 0.1),
    Track3D.unknown(0.0, Status.LOST),
    TaxelEvents(0.0, ("a:1",), np.zeros(1), np.zeros(1), np.zeros(1, bool)),
    Activation(0.0, ("a:1",), np.zeros(1)),
    Reachability.without_answer(0.0, ReachStatus.UNKNOWN),
    JointVelocity(0.0, ZERO, 0.5),
]


def test_arrays_of_a_message_are_read_only_and_the_senders_stays_writeable():
    sent = np.zeros(3)
    message = JointVelocity(0.0, sent, 0.5)
    with pytest.raises(ValueError, match="read-only"):
        message.dq_rad_s[0] = 1.0
    sent[0] = 1.0
    assert sent.flags.writeable


def test_every_message_stays_as_it_is_and_takes_no_other_names():
    assert {type(message) for message in MESSAGES} == {
        member for member in vars(types).values() if is_dataclass(member)
    }
    for message in MESSAGES:
        with pytest.raises(FrozenInstanceError):
            setattr(message, fields(message)[0].name, 2.0)
        assert not hasattr(message, "__dict__"), "a message comes with every frame: slots keep it small"
        arrays = [value for f in fields(message) if isinstance(value := getattr(message, f.name), np.ndarray)]
        assert arrays
        assert not any(array.flags.writeable for array in arrays)


def test_a_camera_without_joints_has_none():
    image = np.zeros((2, 2, 3), np.uint8)
    frame = StereoFrame(image, image, 1.0, 1.5, np.zeros(2))
    assert frame.joints_right_rad is None
    assert frame.stamp_s == 1.25


def test_what_is_not_known_is_no_number():
    searching = Track3D.unknown(1.0)
    for values in (searching.mean, searching.cov, searching.radius_m, searching.radius_var_m2):
        assert np.isnan(values).all()
    coasting = Track3D(0.0, np.arange(12.0).reshape(4, 3), np.eye(12), 0.03, 1e-6, Status.COASTING)
    assert [track.is_known for track in (searching, Track3D.unknown(1.0, Status.LOST), coasting)] == [
        False,
        False,
        True,
    ]
    answer = Reachability.without_answer(2.0, ReachStatus.NOT_FIXATED)
    assert not answer.is_reachable
    assert np.isnan([*answer.gaze_rad, answer.probability, answer.degree]).all()
