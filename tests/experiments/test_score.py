"""Recordings with numbers known in advance: frames that count, near tracks, touch, consistency; pipelines."""

from dataclasses import replace

import numpy as np
import pytest
from tracks import track_at

from pps_vision.experiments.baselines.stereo_pipelines import FilteredPipeline, available_pipelines
from pps_vision.experiments.films.recordings import EYES_M, FPS, Footage, moving
from pps_vision.experiments.films.score import METRICS, judge
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Status, StereoFrame, Track3D

N = 40
AT_M = 0.3
BLACK = np.zeros((240, 320, 3), np.uint8)
BOX = (10.0, 20.0, 30.0, 30.0)


@pytest.fixture
def recording() -> Footage:
    """2 s of an object that rests 0.3 m before the eyes; every image black."""
    stamps = (np.arange(N) / FPS).tolist()
    position = np.tile(EYES_M + np.array([-AT_M, 0, 0]), (N, 1))
    frames = tuple(StereoFrame(BLACK, BLACK, t, t) for t in stamps)
    boxes = ((None, BOX), (BOX, None), *((BOX, BOX),) * (N - 2))
    return Footage(frames, position, np.zeros((N, 3)), np.ones(N, bool), boxes, 0.03, icub_rig(load_icub()), None)


def track(recording: Footage, k: int, off_m: float) -> Track3D:
    """A track beside the truth of a frame, across the line of sight."""
    return track_at(recording.position[k] + [0, off_m, 0], stamp_s=recording.frames[k].stamp_s)


def test_frames_count_when_the_object_was_in_sight_long_enough(recording):
    """From 0.5 s on, again after every time out of sight, and only those asked about."""
    assert np.flatnonzero(recording.judged(0.5)).tolist() == list(range(10, N))
    seen = recording.visible.copy()
    seen[15] = False
    assert np.flatnonzero(replace(recording, visible=seen).judged(0.5)).tolist() == [*range(10, 15), *range(26, N)]
    asked = np.arange(N) < 12
    assert np.flatnonzero(replace(recording, in_question=asked).judged(0.5)).tolist() == [10, 11]


def test_near_is_a_sixth_of_the_distance(recording):
    """0.3 m away: near up to 50 mm."""
    tracks = [track(recording, k, 0.003) for k in range(N)]
    for k, off_m in ((5, 0.2), (9, 0.2), (12, 0.049), (13, 0.051), (14, 0.09), (15, 0.09)):  # 5, 9: before frames count
        tracks[k] = track(recording, k, off_m)
    tracks[16] = Track3D.unknown(recording.frames[16].stamp_s)
    values = judge(recording, tracks)
    assert np.flatnonzero(~values["near"]).tolist() == [3, 4, 5, 6]
    assert len(values["near"]) == 30
    assert sorted(values["error_mm"])[-4:] == pytest.approx([49, 51, 90, 90])
    assert len(values["error_mm"]) == 29, "an unknown track has no error"
    square = 25 * 3**2 + 49**2 + 51**2 + 2 * 90**2
    assert values["recording_rms_mm"] == pytest.approx([np.sqrt(square / 29)])
    summaries = {name: metric.summary(values[metric.values]) for name, metric in METRICS.items()}
    assert summaries["near_percent"] == pytest.approx(100 * 26 / 30)
    assert METRICS["worst_recording_mm"].summary(np.array([2.0, 5.0, 3.0])) == 5


def test_a_straight_approach_touches_with_its_front_when_it_stops(recording):
    """10 cm/s along x for 1 s, a radius of 3 cm."""
    stamps = recording.stamps_s
    moving = stamps < 1.0
    velocity = np.where(moving[:, None], [0.1, 0, 0], 0.0)
    position = np.minimum(stamps, 1.0)[:, None] * [0.1, 0, 0]
    approach = replace(recording, position=position, velocity=velocity)
    touched, ttc_s = approach.touch()
    np.testing.assert_allclose(touched, [0.13, 0, 0], atol=1e-9)
    np.testing.assert_allclose(ttc_s[moving], 1.0 - stamps[moving], atol=1e-9)
    assert np.isnan(ttc_s[~moving]).all()
    uneven = replace(approach, velocity=np.where(stamps[:, None] < 0.5, 1.1 * velocity, velocity))
    for other in (uneven, recording, replace(approach, velocity=np.tile([0.1, 0, 0], (N, 1)))):
        assert np.isnan(other.touch()[0]).all()
        assert np.isnan(other.touch()[1]).all()


@pytest.fixture(scope="module")
def film() -> Footage:
    return moving("ball", "circle", 1, 0.2, noise=0.0)


@pytest.mark.parametrize("name", available_pipelines())
def test_a_pipeline_is_near_the_truth_after_one_frame(name, film):
    """A few per cent of the distance: they see a ball of 7 cm at about 0.4 m."""
    left, right = film.boxes[0]
    assert left is not None
    assert right is not None
    pipeline = FilteredPipeline(name, film.rig, film.frames[0].stamp_s, (left, right))
    first, track = map(pipeline.step, film.frames[:2])
    assert np.linalg.norm(first.position - film.position[0]) < 0.002
    assert track.status == Status.TRACKING
    assert np.linalg.norm(track.position - film.position[1]) < 0.02
    assert np.all(np.linalg.eigvalsh(track.cov[:3, :3]) > 0)
