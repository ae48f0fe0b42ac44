"""The peers' pipelines against the rendered truth, and the time to contact against plain division."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from pps_vision.app.render import Render
from pps_vision.experiments.peers import sphere_box
from pps_vision.experiments.pipeline import Pipeline, ttc_error
from pps_vision.experiments.rendered import Rendered, rendered
from pps_vision.experiments.stereo_peers import FilteredPeer, StereoPeerName, meet, stereo_peer
from pps_vision.types import Status, Track3D


@pytest.fixture(scope="module")
def film() -> Rendered:
    return rendered(Render("ball", "circle", Path(), seconds=0.2, seed=1))


@pytest.mark.parametrize("name", get_args(StereoPeerName))
def test_a_peer_is_near_the_truth_after_one_frame(name: StereoPeerName, film: Rendered) -> None:
    """A few per cent of the distance: they see a ball of 7 cm at about 0.4 m."""
    left, right = film.boxes[0]
    assert left is not None
    assert right is not None
    peer = FilteredPeer(stereo_peer(name, film.rig), film.rig)
    first = peer.start(film.frames[0], (left, right))
    assert np.linalg.norm(first.position - film.truth[0].position) < 0.002
    track = peer.step(film.frames[1])
    assert track.status == Status.TRACKING
    assert np.linalg.norm(track.position - film.truth[1].position) < 0.02
    assert np.all(np.linalg.eigvalsh(track.cov[:3, :3]) > 0)


def test_a_peer_without_points_coasts_and_is_lost(film: Rendered) -> None:
    class Blind:
        def start(self, frame: object, boxes: object) -> None: ...

        def step(self, frame: object) -> None:
            return None

    left, right = film.boxes[0]
    assert left is not None
    assert right is not None
    peer = FilteredPeer(Blind(), film.rig, lost_after_s=0.12)
    peer.start(film.frames[0], (left, right))
    tracks = [peer.step(frame) for frame in film.frames[1:4]]
    assert [track.status for track in tracks] == [Status.COASTING, Status.COASTING, Status.LOST]
    widths = [np.trace(track.cov[:3, :3]) for track in tracks[:2]]
    assert widths[0] < widths[1]


def test_true_boxes_meet_in_the_ball(film: Rendered) -> None:
    for frame, row in zip(film.frames, film.truth, strict=True):
        view = film.rig.view_of(frame)
        left, right = (sphere_box(eye, row.position, row.radius_m) for eye in (view.left, view.right))
        assert left is not None
        assert right is not None
        point = meet(view, left, right)
        assert point is not None
        assert np.linalg.norm(point - row.position) < 0.003


def test_time_to_contact_error_is_relative() -> None:
    mean = np.zeros((4, 3))
    mean[0], mean[1] = (0.06, 0.0, 0.0), (-0.1, 0.05, 0.0)  # 0.6 s from the origin along −x
    track = Track3D(0.0, mean, np.eye(12), 0.03, 1e-6, Status.TRACKING)
    way, end = np.array([-1.0, 0.0, 0.0]), np.zeros(3)
    assert ttc_error(track, end, way, 0.5) == pytest.approx(0.2)
    assert ttc_error(track, end, -way, 0.5) == 1.0  # it goes away
    assert ttc_error(Track3D.unknown(0.0), end, way, 0.5) == 1.0


def test_bad_use_is_named(film: Rendered) -> None:
    with pytest.raises(ValueError, match="--n 0"):
        Pipeline(n=0).run()
    with pytest.raises(ValueError, match=r"three CSRT.*two CSRT"):
        stereo_peer("three CSRT", film.rig)  # type: ignore[arg-type]
