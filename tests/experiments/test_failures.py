"""The disturbances do what they say, and a run is judged by the truth."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.failures import BREAKS, DISTURBANCES, FINE, Failures, fine, methods, plain
from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import Footage


@pytest.fixture(scope="module")
def shown() -> Footage:
    """2.5 s at 100 frames a second, noiseless."""
    return fine("rendered", SEED)


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def test_the_ball_is_where_the_recording_says(shown: Footage) -> None:
    """The truth's projection lies on the red of each eye's image, and the true box holds just that red."""
    for k in (0, 25, 49):
        frame, view = shown.frames[k], shown.rig.view_of(shown.frames[k])
        for image, eye, box in zip((frame.left, frame.right), (view.left, view.right), shown.boxes[k], strict=True):
            red = (image[..., 0] > 120) & (image[..., 1] < 60)
            ys, xs = np.nonzero(red)
            assert np.linalg.norm(eye.project(shown.position[k]) - [xs.mean(), ys.mean()]) < 1.0
            assert box is not None
            x, y, w, h = box
            np.testing.assert_allclose([x, y, x + w - 1, y + h - 1], [xs.min(), ys.min(), xs.max(), ys.max()], atol=2.0)


def test_late_stale_and_jittered_frames_hold_what_was_there_at_the_other_time(shown: Footage) -> None:
    delay_s, k = 0.05, 6  # at 20 frames a second frame 6 is fine frame 30
    late = d.right_late(shown, FINE, delay_s).frames[k]
    assert np.shares_memory(late.left, shown.frames[30].left)
    assert np.shares_memory(late.right, shown.frames[25].right)
    assert late.stamp_right_s == late.stamp_left_s
    np.testing.assert_array_equal(late.joints_right_rad, shown.frames[30].joints_right_rad)
    stale = d.stale_joints(shown, FINE, delay_s).frames[k]
    np.testing.assert_array_equal(stale.joints_left_rad, shown.frames[25].joints_left_rad)
    stamps = d.jittered(shown, FINE, 0.5, rng()).stamps_s
    assert np.all(np.diff(stamps) > 0), "however large the jitter, stamps rise"


def test_noise_blur_and_dropouts_are_as_large_as_said(shown: Footage) -> None:
    frames = d.at_rate(shown, FINE)
    noise = d.noisy(frames, 8.0, rng()).frames[3].left.astype(float) - frames.frames[3].left
    assert np.std(noise[(frames.frames[3].left > 40) & (frames.frames[3].left < 210)]) == pytest.approx(8.0, rel=0.03)
    blurred = d.blurred(shown, FINE, 3)
    middle = np.mean([shown.frames[j].left for j in (9, 10, 11)], axis=0)
    np.testing.assert_allclose(blurred.frames[1].left, middle, atol=0.51)
    assert blurred.stamps_s[1] == shown.stamps_s[10]
    kept = d.dropped(shown, 0.75, rng())
    assert len(kept.frames) / len(shown.frames) == pytest.approx(0.25, abs=0.08)
    assert len(kept.frames) == len(kept.position) == len(kept.velocity) == len(kept.boxes)


def test_what_fails_for_a_time_is_not_in_sight_then_and_judged_a_while_after(shown: Footage) -> None:
    frames = d.eyes_fail(d.at_rate(shown, FINE), "black", 0.1, 0.2)
    out = (frames.stamps_s >= 0.1) & (frames.stamps_s < 0.2)
    assert all((f.right.max() == 0) == o and f.left.max() > 0 for f, o in zip(frames.frames, out, strict=True))
    np.testing.assert_array_equal(frames.stamps_s[frames.judged(0.1)], frames.stamps_s[frames.stamps_s >= 0.299])


def test_a_dash_through_the_view_in_half_a_second_is_tracked() -> None:
    found = methods()["ours, generic"](DISTURBANCES["speed"].make("rendered", SEED, 10), SEED)
    assert np.mean(found["near"]) >= 0.9
    assert found["recording_rms_mm"][0] < 10


def test_every_disturbance_starts_with_what_is_undisturbed() -> None:
    """One that is cheap to film, at its first severity, is the plain recording with the usual noise."""
    for name in ("pixel noise", "loss of colour", "missing pairs", "head pose stale", "right eye black"):
        axis, make = DISTURBANCES[name]
        first = make("rendered", SEED, axis.severities[0])
        usual = d.noisy(plain("rendered", SEED), 2.0, np.random.default_rng((SEED, 2)))
        np.testing.assert_array_equal(first.frames[-1].left, usual.frames[-1].left)


def test_charts_and_tables_have_a_place_for_every_disturbance() -> None:
    cells = {}
    for name, one in DISTURBANCES.items():
        near = [[100.0 if k < 2 else 50.0] * 3 for k in range(len(one.axis.severities))]
        cell = {"near_percent": near, "breaks_at": one.axis.severities[2]}
        cells[name] = {
            "axis": one.axis.label,
            "severities": list(one.axis.severities),
            "methods": dict.fromkeys(methods(), cell),
        }
    figure = Failures().chart({"rendered": cells})
    axis = figure.axes[0]
    assert [tick.get_text() for tick in axis.get_yticklabels()] == list(DISTURBANCES)
    told = [f"{one.axis.severities[2]:g}" for one in DISTURBANCES.values() for _ in methods()]
    assert [text.get_text() for text in axis.texts] == told
    borne = [[100 * 2 / len(one.axis.severities)] * len(methods()) for one in DISTURBANCES.values()]
    np.testing.assert_allclose(axis.images[0].get_array(), borne)
    rows = Failures().tables({"rendered": cells})["rendered"].rows
    assert [row[2] for row in rows] == [f"{one.axis.severities[2]:g}" for one in DISTURBANCES.values()]
    assert BREAKS.bound == 90
