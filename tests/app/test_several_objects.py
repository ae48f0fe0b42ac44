"""A film with two balls through the command line and the library: two tracks, each near its ball."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from ball_scenes import Sphere, look
from calibrations import write_calibration
from laboratory import write

import pps_vision as pv
from pps_vision.app.cli import main
from pps_vision.app.report.colors import track_hex
from pps_vision.geometry.camera import Camera, StereoRig
from tracking.tracker import Tracker, TrackerParams

N, FPS, SIZE = 40, 20, (320, 240)
FOCAL_PX, CENTER_PX = 300.0, (159.5, 119.5)
COMES_FROM = 10  # frame in which the second ball starts


def places(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a ball that passes from the left to the right, and of one that comes from behind it, in frame `k`, m."""
    comes_s = max(k - COMES_FROM, 0) / FPS
    return np.array([-0.2 + 0.15 * k / FPS, 0.1, 0.8]), np.array([0.2, -0.12, 1.2 - 0.35 * comes_s])


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    camera = Camera(*SIZE, FOCAL_PX, FOCAL_PX, *CENTER_PX)
    T_left_right = np.eye(4)
    T_left_right[0, 3] = 0.1
    view = StereoRig.fixed(camera, camera, T_left_right).view()
    rng = np.random.default_rng(3)
    for k in range(N):
        passing, coming = places(k)
        spheres = [Sphere(passing, 0.04, (200, 40, 30)), Sphere(coming, 0.05, (40, 70, 200))]
        for name, eye in (("left", view.left), ("right", view.right)):
            write(folder / name / f"{k:03d}.png", look(eye, spheres, rng))
    write_calibration(folder / "calibration.yml", FOCAL_PX, CENTER_PX, SIZE)
    return folder


def options(film: Path) -> dict[str, object]:
    return {"left": film / "left", "right": film / "right", "calib": film / "calibration.yml", "fps": FPS}


def track(film: Path, out: Path, *more: str) -> list[dict[str, str]]:
    """Rows of trajectory.csv."""
    words = [word for name, value in options(film).items() for word in (f"--{name}", str(value))]
    main(["track", *words, "--out", str(out), *more])
    with (out / "trajectory.csv").open() as lines:
        return list(csv.DictReader(lines))


def place_of(row: dict[str, str]) -> list[float]:
    return [float(row[name] or "nan") for name in ("x_m", "y_m", "z_m")]


def test_two_objects_are_two_tracks_each_near_its_truth(film, tmp_path, capsys):
    rows = track(film, tmp_path / "out", "--also", "mot", "--smooth", "--report")
    assert ", 2 tracks →" in capsys.readouterr().out
    stamps = [float(row["stamp_s"]) for row in rows]
    assert sorted(set(stamps)) == pytest.approx(np.arange(N) / FPS)
    known = [row for row in rows if row["x_m"]]
    ids = sorted({int(row["track_id"]) for row in known})
    assert len(ids) == 2
    errors_mm = {track_id: [] for track_id in ids}
    for row in known:
        truth = places(round(FPS * float(row["stamp_s"])))[ids.index(int(row["track_id"]))]
        errors_mm[int(row["track_id"])].append(1000 * np.linalg.norm(place_of(row) - truth))
    for track_id, first in zip(ids, (0, COMES_FROM), strict=True):
        assert len(errors_mm[track_id]) > N - first - 11, "within half a second"
        assert np.median(errors_mm[track_id]) < 2
        assert max(errors_mm[track_id]) < 20
    first_rows = [row for k, row in enumerate(rows) if stamps.index(stamps[k]) == k]
    attended = [int(row["track_id"]) for row in first_rows if row["x_m"]]
    assert attended[-1] == ids[1], "the one that comes"
    boxes = np.loadtxt(tmp_path / "out" / "mot_left.txt", delimiter=",")
    assert set(boxes[:, 1]) == set(ids)
    assert [sorted(boxes[boxes[:, 0] == N, 1])] == [ids]
    numbers = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert numbers["objects"] == 4
    by_id = {item["track_id"]: item for item in numbers["tracks"]}
    assert [by_id[track_id]["tracking"] + by_id[track_id]["coasting"] for track_id in ids] == list(
        map(len, errors_mm.values())
    )
    assert [by_id[track_id]["attended"] for track_id in ids] == [attended.count(track_id) for track_id in ids]
    page = (tmp_path / "out" / "report.html").read_text()
    lines = json.loads(re.search(r'id="path-data">(.*?)</script>', page)[1])["lines"]
    assert {line["color"] for line in lines if line["width"] > 1} == {track_hex(track_id) for track_id in ids}
    assert f"<td>track {ids[1]}: pairs, attended</td>" in page
    diameters = [by_id[track_id]["object"]["diameter_m"] for track_id in ids]
    assert diameters == pytest.approx([0.08, 0.1], rel=0.05)


def test_one_object_is_followed_exactly_as_by_the_tracker(film, tmp_path):
    rows = track(film, tmp_path / "out", "--one")
    recording = pv.open_recording(**options(film))
    tracker = Tracker(TrackerParams(max_objects=1), recording.rig, np.random.default_rng(0))
    steps = [tracker.step(frame) for frame in recording]
    assert not any(step.others for step in steps)
    np.testing.assert_array_equal([place_of(row) for row in rows], [step.track.position for step in steps])
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["objects"] == 1
    path = pv.track(recording, objects=1).arrays()
    np.testing.assert_array_equal(path.position, [step.track.position for step in steps])
    assert [int(row["track_id"]) for row in rows] == path.track_id.tolist()


def test_the_library_gives_the_path_of_each_track(film, tmp_path):
    rows = track(film, tmp_path / "out", "--objects", "2", "--device", "cpu")
    paths = pv.track(pv.open_recording(**options(film)), objects=2, device="cpu").arrays_by_track()
    assert len(paths) == 2
    for track_id, path in paths.items():
        assert len(path.stamps_s) == N
        of_track = [place_of(row) for row in rows if row["x_m"] and int(row["track_id"]) == track_id]
        np.testing.assert_array_equal(path.position[np.isfinite(path.position[:, 0])], of_track)


def test_a_number_of_objects_that_cannot_be_followed_is_refused(film, tmp_path, refused):
    words = [word for name, value in options(film).items() for word in (f"--{name}", value)]
    for number in (0, 5):
        line = refused("track", *words, "--out", tmp_path / "out", "--objects", number)
        assert f"{number} objects; expected 1 to 4" in line
