"""The baselines' pipelines against the rendered truth."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from pps_vision.experiments.baselines.image_trackers import middle, sphere_box
from pps_vision.experiments.baselines.stereo_pipelines import (
    FilteredPipeline,
    StereoPipelineName,
    intersection,
    stereo_pipeline,
)
from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.types import Status


@pytest.fixture(scope="module")
def film() -> Footage:
    return moving("ball", "circle", 1, 0.2, noise=0.0)


@pytest.mark.parametrize("name", get_args(StereoPipelineName))
def test_a_pipeline_is_near_the_truth_after_one_frame(name: StereoPipelineName, film: Footage) -> None:
    """A few per cent of the distance: they see a ball of 7 cm at about 0.4 m."""
    left, right = film.boxes[0]
    assert left is not None
    assert right is not None
    start = (film.rig, film.frames[0], (left, right))
    pipeline = FilteredPipeline(stereo_pipeline(name, *start), *start)
    assert np.linalg.norm(pipeline.first.position - film.position[0]) < 0.002
    track = pipeline.step(film.frames[1])
    assert track.status == Status.TRACKING
    assert np.linalg.norm(track.position - film.position[1]) < 0.02
    assert np.all(np.linalg.eigvalsh(track.cov[:3, :3]) > 0)


def test_a_pipeline_without_points_coasts_and_is_lost(film: Footage) -> None:
    left, right = film.boxes[0]
    assert left is not None
    assert right is not None
    pipeline = FilteredPipeline(lambda _: None, film.rig, film.frames[0], (left, right), lost_after_s=0.12)
    tracks = [pipeline.step(frame) for frame in film.frames[1:4]]
    assert [track.status for track in tracks] == [Status.COASTING, Status.COASTING, Status.LOST]
    widths = [np.trace(track.cov[:3, :3]) for track in tracks[:2]]
    assert widths[0] < widths[1]


def test_true_boxes_meet_in_the_ball(film: Footage) -> None:
    for frame, position in zip(film.frames, film.position, strict=True):
        view = film.rig.view_of(frame)
        left, right = (sphere_box(eye, position, film.radius_m) for eye in (view.left, view.right))
        assert left is not None
        assert right is not None
        point = intersection(view, middle(left), middle(right))
        assert point is not None
        assert np.linalg.norm(point - position) < 0.003


@pytest.mark.parametrize("name", ["two hue blobs", "SGBM + blob"])
def test_where_nothing_has_the_hues_of_the_object_there_is_no_point(name: StereoPipelineName, film: Footage) -> None:
    frame, (left, right) = film.frames[0], film.boxes[0]
    assert left is not None
    assert right is not None
    pipeline = stereo_pipeline(name, film.rig, frame, (left, right))
    assert pipeline(frame) is not None
    assert pipeline(replace(frame, left=0 * frame.left, right=0 * frame.right)) is None


def test_bad_use_is_named(film: Footage) -> None:
    with pytest.raises(ValueError, match=r"three CSRT.*two CSRT"):
        stereo_pipeline("three CSRT", film.rig, film.frames[0], film.boxes[0])  # type: ignore[arg-type]
