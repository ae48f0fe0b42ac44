"""Files for other tools are read back by their own libraries read."""

import sys
from importlib.metadata import version
from pathlib import Path

import motmetrics
import numpy as np
import pandas
import pytest
from evo.tools.file_interface import read_tum_trajectory_file
from pycocotools.coco import COCO
from rosbags.highlevel import AnyReader
from tracks import track_at

from pps_vision.errors import InputError
from pps_vision.recordings import Form
from pps_vision.recordings.exchange import TrackedPair, open_forms, write_tum_rows
from pps_vision.types import Detection2D, Status, Track3D

N = 12


def detection(camera: str, k: int) -> Detection2D:
    box = (10.0 + k, 20.5, 8.0, 6.0 + (camera == "right"))
    return Detection2D(
        0.05 * k, camera, np.array([14.0 + k, 23.5]), np.eye(2), 0.9 - 0.1 * (camera == "right"), 0.1, box
    )


@pytest.fixture
def pairs() -> list[TrackedPair]:
    """Nothing in the first pair; lost in the sixth; another track afterwards, beside it a third one in the last."""
    pairs_made = []
    for k in range(N):
        stamp_s = 1403636579.75 + 0.05 * k
        images = (Path(f"left/{k}.png"), Path(f"right/{k}.png"))
        if k in (0, 5):
            track = Track3D.unknown(stamp_s, Status.LOST if k == 5 else Status.SEARCHING)
            pairs_made.append(TrackedPair(images, track, ()))
            continue
        track = track_at((0.1 * np.sin(k), 0.02 * k, 0.5), stamp_s=stamp_s, track_id=1 if k < 5 else 2)
        other = TrackedPair(images, track_at((0, 0, 0.8), stamp_s=stamp_s, track_id=3), (detection("left", k + 99),))
        detections = detection("left", k), detection("right", k)
        pairs_made.append(TrackedPair(images, track, detections, 0.25, (other,) if k == N - 1 else ()))
    return pairs_made


def write(folder: Path, form: Form, pairs: list[TrackedPair]) -> None:
    with open_forms(folder, [form], (320, 240)) as add:
        for pair in pairs:
            add(pair)


def test_evo_reads_tum(tmp_path, pairs):
    write(tmp_path, "tum", pairs)
    read = read_tum_trajectory_file(str(tmp_path / "trajectory.tum"))
    known_tracks = [pair.track for pair in pairs if pair.track.is_known]
    np.testing.assert_array_equal(read.timestamps, [track.stamp_s for track in known_tracks])
    np.testing.assert_array_equal(read.positions_xyz, [track.position for track in known_tracks])
    assert read.check()[0]
    write_tum_rows(
        tmp_path / "again.tum", [track.stamp_s for track in known_tracks], [track.position for track in known_tracks]
    )
    written = (tmp_path / "trajectory.tum").read_text()
    assert (tmp_path / "again.tum").read_text() == written
    assert written.startswith(f"# pps-vision {version('pps-vision')}: stamp_s x_m y_m z_m qx qy qz qw\n")


def test_pandas_reads_anipose(tmp_path, pairs):
    """The columns that `movement` takes: POINT_x, _y, _z and _score for every row.

    movement 0.15 (over 1 GB, so not among the tests' requirements) opened such a file of 200 pairs as
    "Anipose": every position was that of trajectory.csv, in metres, unknown where it is.
    """
    write(tmp_path, "anipose", pairs)
    table = pandas.read_csv(tmp_path / "trajectory_anipose.csv")
    assert table["fnum"].tolist() == list(range(N))
    assert {name.rsplit("_", 1)[0] for name in table.columns if name[-2:] in ("_x", "_y", "_z")} == {"object"}
    np.testing.assert_array_equal(table[["object_x", "object_y", "object_z"]], [p.track.position for p in pairs])
    assert table["object_ncams"].tolist() == [2 * pair.track.is_known for pair in pairs]
    np.testing.assert_allclose(table["object_score"], [0.8 * pair.track.is_known for pair in pairs])
    np.testing.assert_array_equal(table["object_error"], [0.25 if p.track.is_known else np.nan for p in pairs])
    np.testing.assert_array_equal(table[[f"M_{i}{i}" for i in range(3)]], 1)
    np.testing.assert_array_equal(table[[f"center_{axis}" for axis in range(3)]], 0)


def test_motmetrics_reads_mot(tmp_path, pairs):
    write(tmp_path, "mot", pairs)
    for camera, height in (("left", 6.0), ("right", 7.0)):
        read = motmetrics.io.loadtxt(str(tmp_path / f"mot_{camera}.txt"), fmt="mot15-2D")  # counts pixels from 0
        others = [(N, 3)] if camera == "left" else []
        assert read.index.tolist() == [(k + 1, 1 if k < 5 else 2) for k in range(N) if k not in (0, 5)] + others
        places = [k for k in range(N) if k not in (0, 5)] + [N - 1 + 99 for _ in others]
        boxes = [[10.0 + k, 20.5, 8.0, height] for k in places]
        np.testing.assert_allclose(read[["X", "Y", "Width", "Height"]], boxes)


def test_pycocotools_reads_coco(tmp_path, pairs):
    write(tmp_path, "coco", pairs)
    read = COCO(str(tmp_path / "coco.json"))
    assert read.dataset["info"] == {"description": f"pps-vision {version('pps-vision')}"}
    assert len(read.getImgIds()) == 2 * N
    assert len(read.getAnnIds(catIds=read.getCatIds())) == len(read.getAnnIds()), "all are of the named category"
    assert sorted(read.getAnnIds()) == list(range(1, 2 * (N - 2) + 2)), "COCO's evaluation takes 0 for no match"
    for annotation in read.loadAnns(read.getAnnIds()):
        (image,) = read.loadImgs([annotation["image_id"]])
        k = image["frame_id"] - 1
        assert image["file_name"] == f"{image['camera']}/{k}.png"
        k += 99 * (annotation["track_id"] == 3)
        assert annotation["bbox"] == [10.0 + k, 20.5, 8.0, height := 6.0 + (image["camera"] == "right")]
        assert annotation["area"] == 8 * height
        assert annotation["track_id"] == (1 if k < 5 else 2 if k < N else 3)
        assert annotation["iscrowd"] == 0, "an object, not a crowd"
        assert read.annToMask(annotation | {"segmentation": [[0, 0, 4, 0, 4, 4, 0, 4]]}).shape == (240, 320)


def test_without_rosbags_its_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r"trajectory_ros2: needs the extra ros: pip install 'pps-vision\[ros\]'"):
        write(tmp_path, "ros2", [])


def test_rosbags_reads_ros2(tmp_path, pairs):
    write(tmp_path, "ros2", pairs)
    known_tracks = [pair.track for pair in pairs if pair.track.is_known]
    with AnyReader([tmp_path / "trajectory_ros2"]) as bag:
        read = [bag.deserialize(data, connection.msgtype) for connection, _, data in bag.messages()]
    assert len(read) == len(known_tracks)
    for message, track in zip(read, known_tracks, strict=True):
        point = message.pose.pose.position
        stamp = message.header.stamp
        turn = message.pose.pose.orientation
        assert [point.x, point.y, point.z] == track.position.tolist()
        assert [turn.x, turn.y, turn.z, turn.w] == [0, 0, 0, 1]
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(track.stamp_s, abs=1e-6)
        covariance = message.pose.covariance.reshape(6, 6)
        np.testing.assert_array_equal(covariance[:3, :3], track.cov[:3, :3])
        np.testing.assert_array_equal(covariance[3:, 3:], -np.eye(3))  # unknown, as ROS's messages say it
