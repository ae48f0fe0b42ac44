"""The disturbances do what they say, and a run is judged by the truth."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments import disturbances as d
from pps_vision.experiments.failure_cases import CASES
from pps_vision.experiments.failure_methods import OURS, Peers, judge, track_ours
from pps_vision.experiments.failure_scenes import Scenes, stage_props
from pps_vision.experiments.failure_table import table
from pps_vision.experiments.failures import METHODS, Failures, summary
from pps_vision.experiments.footage import EYES_M, Footage, Studio, open_studio
from pps_vision.types import Status, Track3D
from rendering.motions import Circle

EVERY = 5
CIRCLE = Circle(EYES_M + np.array([-0.42, 0.0, -0.06]), np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]]), 0.06, 0.15)


@pytest.fixture(scope="module")
def studio() -> Iterator[Studio]:
    with open_studio(stage_props()) as studio:
        yield studio


@pytest.fixture(scope="module")
def fine(studio: Studio) -> Footage:
    """Half a second at 100 frames a second, noiseless."""
    return studio.film(CIRCLE, 0.5, studio.follow, fps=20 * EVERY)


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def known(stamp_s: float, position: np.ndarray, std_m: float = 0.01) -> Track3D:
    mean = np.zeros((4, 3))
    mean[0] = position
    return Track3D(stamp_s, mean, std_m**2 * np.eye(12), 0.03, 1e-6, Status.TRACKING)


def test_the_ball_is_where_the_footage_says(fine: Footage) -> None:
    """The truth's projection lies on the red of each eye's image, and the first box holds just that red."""
    for k in (0, 25, 49):
        frame, view = fine.frames[k], fine.rig.view_of(fine.frames[k])
        for image, eye in ((frame.left, view.left), (frame.right, view.right)):
            red = (image[..., 0] > 120) & (image[..., 1] < 60)
            ys, xs = np.nonzero(red)
            assert np.linalg.norm(eye.project(fine.position[k]) - [xs.mean(), ys.mean()]) < 1.0
            if k == 0:
                x, y, w, h = fine.boxes[0 if eye is view.left else 1]
                box = [x, y, x + w - 1, y + h - 1]
                np.testing.assert_allclose(box, [xs.min(), ys.min(), xs.max(), ys.max()], atol=2.0)


def test_late_stale_and_jittered_frames_hold_what_was_there_at_the_other_time(fine: Footage) -> None:
    delay_s, k = 0.05, 6  # at 20 frames a second frame 6 is fine frame 30
    late = d.right_late(fine, EVERY, delay_s, stamped=True).frames[k]
    assert late.left is fine.frames[30].left
    assert late.right is fine.frames[25].right
    assert late.stamp_right_s == pytest.approx(late.stamp_left_s - delay_s)
    np.testing.assert_array_equal(late.joints_right_rad, fine.frames[25].joints_right_rad)
    np.testing.assert_allclose(
        d.right_late(fine, EVERY, 0.04, stamped=True).position[k], fine.position[28]
    )  # of the pair's mean stamp
    silent = d.right_late(fine, EVERY, delay_s, stamped=False).frames[k]
    assert silent.stamp_right_s == silent.stamp_left_s
    np.testing.assert_array_equal(silent.joints_right_rad, fine.frames[30].joints_right_rad)
    stale = d.stale_joints(fine, EVERY, delay_s).frames[k]
    np.testing.assert_array_equal(stale.joints_left_rad, fine.frames[25].joints_left_rad)
    stamps = d.jittered(fine, EVERY, 0.5, rng()).stamps_s
    assert np.all(np.diff(stamps) > 0), "however large the jitter, stamps rise"


def test_noise_blur_dropouts_and_repeats_are_as_large_as_said(fine: Footage) -> None:
    frames = d.at_rate(fine, EVERY)
    noise = d.noisy(frames, 8.0, rng()).frames[3].left.astype(float) - frames.frames[3].left
    assert np.std(noise[(frames.frames[3].left > 40) & (frames.frames[3].left < 210)]) == pytest.approx(8.0, rel=0.03)
    blurred = d.blurred(fine, EVERY, 3)
    middle = np.mean([fine.frames[j].left for j in (9, 10, 11)], axis=0)
    np.testing.assert_allclose(blurred.frames[1].left, middle, atol=0.51)
    assert blurred.stamps_s[1] == fine.stamps_s[10]
    many = replace(fine, frames=fine.frames * 20, position=np.tile(fine.position, (20, 1)), seen=np.tile(fine.seen, 20))
    assert len(d.dropped(many, 0.75, rng()).frames) / 1000 == pytest.approx(0.25, abs=0.04)
    shown = d.repeated(many, 0.75, rng()).frames
    assert np.mean([a.left is b.left for a, b in pairwise(shown)]) == pytest.approx(0.75, abs=0.04)


def test_what_fails_for_a_time_is_not_in_sight_then_and_judged_a_while_after(fine: Footage) -> None:
    frames = d.eyes_fail(d.at_rate(fine, EVERY), "black", 0.1, 0.2)
    out = (frames.stamps_s >= 0.1) & (frames.stamps_s < 0.2)
    assert all((f.right.max() == 0) == o and f.left.max() > 0 for f, o in zip(frames.frames, out, strict=True))
    np.testing.assert_array_equal(frames.stamps_s[frames.judged(0.1)], frames.stamps_s[frames.stamps_s >= 0.299])


def test_the_judge_knows_right_from_wrong_and_wrong_from_unsure(fine: Footage) -> None:
    far = np.array([0.2, 0.0, 0.0])
    footage = replace(fine, asked=np.arange(50) >= 25)
    right = [known(s, p + 0.004) for s, p in zip(fine.stamps_s, fine.position, strict=True)]
    score = judge(replace(footage, seen=np.ones(50, bool)), right, settle_s=0.0)
    assert (score.success, score.wrong) == (1.0, 0.0)
    assert score.rms_m == pytest.approx(0.004 * np.sqrt(3))
    for std, wrong in ((0.01, 0.5), (0.1, 0.0)):  # of the 25 frames that count
        half = [known(t.stamp_s, t.position + far, std) if k % 2 else t for k, t in enumerate(right)]
        score = judge(footage, half, settle_s=0.0)
        assert score.success == pytest.approx(0.5, abs=0.03)
        assert score.wrong == pytest.approx(wrong, abs=0.03)
    other = [known(t.stamp_s, t.position + far) for t in right]
    assert judge(replace(footage, or_position=fine.position + far), other, settle_s=0.0).success == 1.0
    nothing = [Track3D.unknown(s) for s in fine.stamps_s]
    assert judge(footage, nothing, settle_s=0.0).success == 0.0


def test_a_dash_through_the_view_in_half_a_second_is_followed(studio: Studio) -> None:
    score = judge(footage := Scenes(studio, SEED).dash(10), track_ours(OURS["ours"], footage, SEED))
    assert score.success >= 0.9
    assert score.rms_m < 0.010


def test_peers_remember_what_they_saw(studio: Studio, fine: Footage) -> None:
    """A second look at the same images, with another calibration, asks no tracker again; the answer differs."""
    peers, frames = Peers(), d.at_rate(fine, EVERY)
    first = peers.track("CamShift", frames)
    asked = len(peers._boxes)
    moved = peers.track("CamShift", d.miscalibrated(frames, 0.05, rng()))
    assert (asked, len(peers._boxes)) == (2, 2)
    assert np.linalg.norm(first[-1].position - frames.position[-1]) < 0.02
    assert np.linalg.norm(first[-1].position - moved[-1].position) > 0.005


def test_every_case_begins_mild_and_has_its_place_in_a_chart() -> None:
    good = {"success": 1.0, "rms_m": 0.001, "wrong": 0.0}
    bad = {"success": 0.5, "rms_m": 0.1, "wrong": 0.2}
    cases = {}
    for case in CASES:
        recording = [dict.fromkeys(METHODS, good if k < 2 else bad) for k in range(len(case.severities))]
        cases[case.name] = summary(case, [recording])
        broken = cases[case.name]["methods"]["ours"]
        assert broken["breaks_at"] == broken["degrades_at"] == case.severities[2]
    charts = Failures().chart({"cases": cases})
    titles = [axis.get_title() for figure in charts.values() for axis in figure.axes if axis.get_title()]
    assert sorted(titles) == sorted(case.name for case in CASES)


def test_a_bench_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="--n 0; expected at least 1"):
        Failures(n=0).run()


def test_the_failure_map_shows_the_measured_table() -> None:
    docs = Path(__file__).parents[2] / "docs"
    numbers = json.loads((docs / "results" / "failures.json").read_text())
    assert table(numbers) in (docs / "failure_map.md").read_text(), (
        "write what `python -m pps_vision.experiments.failure_table` prints into docs/failure_map.md"
    )
