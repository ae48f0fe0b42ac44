"""Disturbances of recordings have the stated size, and the ball is where the recording says."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import Footage
from pps_vision.experiments.severity.tracking import FINE, fine

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def recording() -> Footage:
    """2.5 s at 100 frames a second, noiseless."""
    return fine("rendered", SEED)


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def test_late_and_stale_frames_are_of_an_earlier_time(recording):
    delay_s = 0.05
    k = 6  # at 20 frames a second frame 6 is fine frame 30
    late = d.right_late(recording, FINE, delay_s).frames[k]
    assert np.shares_memory(late.left, recording.frames[30].left)
    assert np.shares_memory(late.right, recording.frames[25].right)
    np.testing.assert_array_equal(late.joints_right_rad, recording.frames[30].joints_right_rad)
    stale = d.stale_joints(recording, FINE, delay_s).frames[k]
    np.testing.assert_array_equal(stale.joints_left_rad, recording.frames[25].joints_left_rad)
    assert np.all(np.diff(d.jittered(recording, FINE, 0.5, rng()).stamps_s) > 0), "stamps rise with any jitter"
