"""The baselines' pipelines against the rendered truth."""

import numpy as np
import pytest

from pps_vision.experiments.baselines.image_trackers import middle, sphere_box
from pps_vision.experiments.baselines.stereo_pipelines import STEREO_PIPELINES, FilteredPipeline, intersection
from pps_vision.experiments.films.recordings import Footage, moving
from pps_vision.types import Status


@pytest.fixture(scope="module")
def film() -> Footage:
    return moving("ball", "circle", 1, 0.2, noise=0.0)


@pytest.mark.parametrize("name", STEREO_PIPELINES)
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


def test_true_boxes_meet_in_the_ball(film):
    for frame, position in zip(film.frames, film.position, strict=True):
        view = film.rig.view_of(frame)
        left, right = (sphere_box(eye, position, film.radius_m) for eye in (view.left, view.right))
        assert left is not None
        assert right is not None
        point = intersection(view, middle(left), middle(right))
        assert point is not None
        assert np.linalg.norm(point - position) < 0.003
