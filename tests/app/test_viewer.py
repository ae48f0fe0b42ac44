"""The view of `track --viewer` is what Rerun's own reader finds in it."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tracks import track_at
from videos import coded, number_of, write_video

from pps_vision.app.cli import main
from pps_vision.app.report.viewer import ViewFile
from pps_vision.types import Detection2D, Status, StereoFrame, Track3D, Truth
from tracking.tracker import TrackerStep

N = 6
START_S = 1403636579.75
OTHER = (1.0, 0.0, 2.0)
COV = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 9.0]]) * 1e-6
CHI2_95 = 7.814727903251179  # of 3 degrees of freedom


def position(k: int) -> np.ndarray:
    return np.array([0.0, 0.3, 0.4 + 0.1 * k])


def step(k: int) -> TrackerStep:
    """Lost in the third frame; otherwise approaching the origin at 0.5 m/s, detected by the left eye; in the last frame
    beside another track at rest."""
    stamp_s = START_S + 0.05 * k
    if k == 2:
        return TrackerStep(Track3D.unknown(stamp_s, Status.LOST), (), None, np.zeros((2, 3)))
    cov = np.eye(12)
    cov[:3, :3] = COV
    track = track_at(position(k), -0.5 * position(k) / np.linalg.norm(position(k)), stamp_s, cov)
    detection = Detection2D(stamp_s, "left", np.array([10.5 + k, 20.0]), np.eye(2), 0.9, 0.1, (0, 0, 9, 9))
    other = TrackerStep(track_at(OTHER, stamp_s=stamp_s, track_id=2), (), None, np.zeros((2, 3)))
    return TrackerStep(track, (detection,), None, np.zeros((2, 3)), others=(other,) if k == N - 1 else ())


@pytest.fixture
def entities(tmp_path: Path) -> dict[str, list[dict[str, object]]]:
    """Rows of each entity of a view, in order of time."""
    rrd = pytest.importorskip("rerun.chunk", reason="needs the extra viewer; in make test-all")
    with ViewFile(tmp_path / "view.rrd") as view:
        for k in range(N):
            stamp_s = START_S + 0.05 * k
            view.add(StereoFrame(coded(k), coded(k + 100), stamp_s, stamp_s), step(k))
        still = np.zeros(3), 0.03, np.zeros(2), np.zeros(2), True, True
        view.finish([Truth(START_S, np.array([1.0, 2.0, 3.0]), *still), Truth(START_S + 1, np.ones(3), *still)])
    by_entity: dict[str, list[dict[str, object]]] = {}
    for chunk in rrd.RrdReader(tmp_path / "view.rrd").stream():
        for row in chunk.to_record_batch().to_pylist():
            plain = {name.rpartition(":")[2]: value for name, value in row.items() if value is not None}
            by_entity.setdefault(chunk.entity_path, []).append(plain)
    return {name: sorted(rows, key=lambda row: row.get("stamp", 0)) for name, rows in by_entity.items()}


def test_a_view_holds_what_was_tracked(entities):
    for camera, first in (("left", 0), ("right", 100)):
        images = [cv2.imdecode(np.array(row["blob"][0], np.uint8), cv2.IMREAD_COLOR) for row in entities[f"/{camera}"]]
        assert [number_of(image) for image in images] == [first + k for k in range(N)]
    stamps = [row["stamp"].total_seconds() for row in entities["/left"]]
    np.testing.assert_allclose(stamps, START_S + 0.05 * np.arange(N), rtol=0, atol=1e-6)
    tracked = [k for k in range(N) if k != 2]
    points = [row["positions"] for row in entities["/left/detection"]]
    assert points == [[[10.5 + k, 20.0]] if k != 2 else [] for k in range(N)]
    assert all(row["positions"] == [] for row in entities["/right/detection"])
    ellipsoids = [row for row in entities["/track"] if "half_sizes" in row]
    assert len(ellipsoids) == len(tracked)
    for k, row in zip(tracked, ellipsoids, strict=True):
        np.testing.assert_allclose(row["centers"][0], position(k), rtol=1e-6)
        turn = Rotation.from_quat(row["quaternions"][0]).as_matrix()
        cov = turn @ np.diag(np.square(row["half_sizes"][0]) / CHI2_95) @ turn.T
        np.testing.assert_allclose(cov, COV, atol=1e-9)
    assert sum("is_recursive" in row for row in entities["/track"]) == 1
    distance = [row["scalars"][0] for row in entities["/distance"]]
    np.testing.assert_allclose(distance, [np.hypot(0.3, 0.4 + 0.1 * k) for k in tracked])
    np.testing.assert_allclose([row["scalars"][0] for row in entities["/time_to_contact"]], np.array(distance) / 0.5)
    np.testing.assert_allclose([row["centers"] for row in ellipsoids][-1], [position(N - 1), OTHER], rtol=1e-6)
    assert ellipsoids[-1]["labels"] == ["1 (attended)", "2"]
    assert len(set(ellipsoids[-1]["colors"])) == 2
    (path,), (truth,) = entities["/path"], entities["/truth"]
    assert [len(strip) for strip in path["strips"]] == [2, 3, 1]
    np.testing.assert_allclose(truth["strips"], [[[1, 2, 3], [1, 1, 1]]])


def test_track_writes_it(tmp_path, calib):
    rrd = pytest.importorskip("rerun.chunk", reason="needs the extra viewer; in make test-all")
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(3)])
    out = tmp_path / "out"
    main(["track", str(tmp_path / "a.mp4"), "--calib", str(calib), "--viewer", "--out", str(out)])
    chunks = list(rrd.RrdReader(out / "view.rrd").stream())
    assert sum(chunk.num_rows for chunk in chunks if chunk.entity_path == "/right") == 3


def test_without_the_extra(tmp_path, calib, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    write_video(tmp_path / "a.mp4", [0.0, 0.1])
    words = ("track", tmp_path / "a.mp4", "--calib", calib, "--viewer", "--out", tmp_path / "out")
    assert "pip install 'pps-vision[viewer]'" in refused(*words)
    assert not (tmp_path / "out").exists()
