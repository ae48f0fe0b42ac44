"""Disturbances of recordings have the stated size, and the ball is where the recording says."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import Footage
from pps_vision.experiments.severity.tracking import DISTURBANCES, FINE, METHODS, fine


@pytest.fixture(scope="module")
def recording() -> Footage:
    """2.5 s at 100 frames a second, noiseless."""
    return fine("rendered", SEED)


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def test_the_true_boxes_hold_the_red_of_the_images(recording: Footage) -> None:
    for k in (0, 49):
        frame = recording.frames[k]
        for image, box in zip((frame.left, frame.right), recording.boxes[k], strict=True):
            ys, xs = np.nonzero((image[..., 0] > 120) & (image[..., 1] < 60))
            x, y, w, h = box
            np.testing.assert_allclose([x, y, x + w - 1, y + h - 1], [xs.min(), ys.min(), xs.max(), ys.max()], atol=2.0)


def test_late_and_stale_frames_are_of_an_earlier_time(recording: Footage) -> None:
    delay_s = 0.05
    k = 6  # at 20 frames a second frame 6 is fine frame 30
    late = d.right_late(recording, FINE, delay_s).frames[k]
    assert np.shares_memory(late.left, recording.frames[30].left)
    assert np.shares_memory(late.right, recording.frames[25].right)
    np.testing.assert_array_equal(late.joints_right_rad, recording.frames[30].joints_right_rad)
    stale = d.stale_joints(recording, FINE, delay_s).frames[k]
    np.testing.assert_array_equal(stale.joints_left_rad, recording.frames[25].joints_left_rad)
    assert np.all(np.diff(d.jittered(recording, FINE, 0.5, rng()).stamps_s) > 0), "stamps rise with any jitter"


def test_noise_blur_and_dropouts_have_the_stated_size(recording: Footage) -> None:
    plain_left = recording.frames[3 * FINE].left
    noise = d.noisy(d.at_rate(recording, FINE), 8.0, rng()).frames[3].left.astype(float) - plain_left
    assert np.std(noise[(plain_left > 40) & (plain_left < 210)]) == pytest.approx(8.0, rel=0.03)
    mean = np.mean([recording.frames[j].left for j in (9, 10, 11)], axis=0)
    np.testing.assert_allclose(d.blurred(recording, FINE, 3).frames[1].left, mean, atol=0.51)
    kept = d.dropped(recording, 0.75, rng())
    assert len(kept.frames) == len(kept.position) == pytest.approx(0.25 * len(recording.frames), abs=20)


def test_a_dash_through_the_view_in_half_a_second_is_tracked() -> None:
    _, dash = DISTURBANCES["speed"]
    values = METHODS["ours, generic"](dash("rendered", SEED, 10), SEED)
    assert np.mean(values["near"]) >= 0.9
    assert values["recording_rms_mm"][0] < 10
