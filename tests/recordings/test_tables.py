"""CSV tables: columns, empty fields, written rows are read back, and every wrong line is named."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from tracks import track_at

from pps_vision.errors import InputError
from pps_vision.recordings.atomic_write import write_json
from pps_vision.recordings.tables import (
    DETECTIONS,
    REACHABILITY,
    TRAJECTORY,
    detection_row,
    numbers,
    read_gaze,
    read_joint_offsets,
    read_table,
    read_truth,
    trajectory_row,
    write_boxes,
    write_joint_offsets,
    write_reachability,
    write_table,
    write_truth,
)
from pps_vision.recordings.text import first_row
from pps_vision.recordings.warnings import ProblemKind
from pps_vision.types import Detection2D, Reachability, ReachStatus, Status, Track3D, Truth

JOINTS = ("neck_pitch", "eyes_tilt", "left_elbow")
HEADER = (
    "stamp_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,radius_m,"
    "u_left_px,v_left_px,u_right_px,v_right_px,visible_left,visible_right"
)
GOOD = "0.1,1,2,3,4,5,6,0.03,10,11,12,13,1,0"


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_detections(tmp_path):
    file = tmp_path / "detections.csv"
    detection = Detection2D(
        1512784563.547172, "right", np.array([1 / 3, 2.0]), np.array([[4.0, 5], [5, 6]]), 0.5, 0.1, (0, 0, 1, 1)
    )
    write_table(file, DETECTIONS, [detection_row(8, detection, track_at((0, 0, 1), track_id=3))])
    assert file.read_text().splitlines()[0] == (
        "frame,stamp_s,camera,u_px,v_px,cov_uu_px2,cov_uv_px2,cov_vv_px2,score,status,track_id"
    )
    (row,) = rows_of(file)
    assert (row["frame"], row["camera"], row["status"], row["track_id"]) == ("8", "right", "tracking", "3")
    assert (float(row["stamp_s"]), float(row["u_px"]), float(row["v_px"])) == (1512784563.547172, 1 / 3, 2)
    assert (float(row["cov_uu_px2"]), float(row["cov_uv_px2"]), float(row["cov_vv_px2"])) == (4, 5, 6)


def test_trajectory(tmp_path):
    file = tmp_path / "trajectory.csv"
    cov = np.zeros((12, 12))
    cov[:3, :3] = [[1, 2, 3], [2, 4, 5], [3, 5, 6]]
    track = Track3D(0.5, np.arange(12.0).reshape(4, 3), cov, 0.03, 1e-6, Status.COASTING, track_id=7)
    write_table(file, TRAJECTORY, map(trajectory_row, [Track3D.unknown(0.0), track]))
    assert file.read_text().splitlines()[0] == (
        "stamp_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,"
        "cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2,radius_m,status,"
        "sigma_x_m,sigma_y_m,sigma_z_m,radius_95_m,track_id"
    )
    nothing, row = rows_of(file)
    assert nothing["x_m"] == nothing["cov_zz_m2"] == nothing["radius_m"] == ""
    assert (nothing["status"], row["track_id"]) == ("searching", "7")
    assert [float(row[key]) for key in ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")] == [0, 1, 2, 3, 4, 5]
    assert [float(row[f"cov_{key}_m2"]) for key in ("xx", "xy", "xz", "yy", "yz", "zz")] == [1, 2, 3, 4, 5, 6]
    assert [float(row[f"sigma_{axis}_m"]) for axis in "xyz"] == pytest.approx(np.sqrt([1, 4, 6]))
    assert float(row["radius_95_m"]) == pytest.approx(np.sqrt(chi2.ppf(0.95, 3) * np.linalg.eigvalsh(cov[:3, :3])[-1]))


def test_boxes(tmp_path):
    write_boxes(tmp_path / "boxes.csv", [(1, (10.5, 20.0, 3.0, 4.0), 1.0)])
    assert (tmp_path / "boxes.csv").read_text() == "frame,x,y,w,h,score\n1,10.5,20.0,3.0,4.0,1.0\n"


def test_a_summary_is_json_that_any_reader_takes(tmp_path):
    file = tmp_path / "summary.json"
    summary = {"n": np.int64(3), "ms": np.array([1.0, np.nan]), "error": float("inf"), "on": np.True_, "kind": (1, "σ")}
    write_json(file, summary)
    assert '"σ"' in file.read_text(), "as a person reads it"
    assert json.loads(file.read_text()) == {"n": 3, "ms": [1.0, None], "error": None, "on": True, "kind": [1, "σ"]}


def test_rows_come_back_as_they_were(tmp_path):
    rng = np.random.default_rng(1)
    row = Truth(
        *(1512784563.547172, rng.normal(size=3), rng.normal(size=3), np.float64(0.03)),
        *(np.array([np.nan, np.nan]), rng.normal(size=2), False, np.True_),
    )
    write_truth(tmp_path / "truth.csv", [row])
    assert (tmp_path / "truth.csv").read_text().splitlines()[0] == HEADER
    problems: list = []
    (back,) = read_truth(tmp_path / "truth.csv", problems)
    assert problems == []
    assert (back.stamp_s, back.radius_m) == (row.stamp_s, row.radius_m)
    assert (back.visible_left, back.visible_right) == (False, True)
    for name in ("position", "velocity", "left_px", "right_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(row, name))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0.1,1,2", "expected finite"),
        (GOOD.replace("0.03", "abc"), "abc"),
        (GOOD.replace("0.1,1", "0.1,"), "expected finite"),
        (GOOD.replace(",1,0", ",2,0"), "visible 2,0"),
        (GOOD.replace(",1,0", ",x,0"), "visible x,0"),
    ],
)
def test_a_bad_row_is_named_and_skipped(tmp_path, row, message):
    file = tmp_path / "truth.csv"
    file.write_text("\n".join([HEADER, GOOD, row, GOOD]))
    problems: list = []
    assert len(read_truth(file, problems)) == 2
    assert [(p.kind, p.file, p.line) for p in problems] == [(ProblemKind.ROW, file, 3)]
    assert message in problems[0].message


def test_a_truth_of_other_columns_is_refused(tmp_path):
    (tmp_path / "truth.csv").write_text("t,x,y,z\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"truth\.csv:1: no column stamp_s, .*; expected stamp_s"):
        read_truth(tmp_path / "truth.csv", [])
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_truth(tmp_path / "none.csv", [])


def test_joint_offsets_are_read_as_written(tmp_path):
    offsets = np.array([0.01, 0.0, -0.02])
    write_joint_offsets(tmp_path / "joints.csv", JOINTS, offsets)
    np.testing.assert_allclose(read_joint_offsets(tmp_path / "joints.csv", JOINTS), offsets, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "joints.csv:1: no column joint, offset_deg; expected joint,offset_deg"),
        ("joint,degrees\n", "joints.csv:1: no column offset_deg"),
        ("joint,offset_deg\nknee,1\n", "joints.csv:2: joint 'knee'; expected each of neck_pitch"),
        ("joint,offset_deg\nleft_elbow\n", "joints.csv:2: left_elbow ''; expected a number"),
        ("joint,offset_deg\nleft_elbow,nan\n", "joints.csv:2: left_elbow 'nan'"),
        ("joint,offset_deg\nleft_elbow,-90.5\n", "joints.csv:2: left_elbow '-90.5'; expected an offset within ±90"),
        ("joint,offset_deg\nleft_elbow,inf\n", "joints.csv:2: left_elbow 'inf'"),
        ("joint,offset_deg\nleft_elbow,1 deg\n", "joints.csv:2: left_elbow '1 deg'"),
        ("joint,offset_deg\nleft_elbow,1\nleft_elbow,2\n", "joints.csv:3: joint 'left_elbow'; expected each of"),
        ("\x00", "joints.csv"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, text, says):
    (tmp_path / "joints.csv").write_text(text)
    with pytest.raises(InputError) as refusal:
        read_joint_offsets(tmp_path / "joints.csv", JOINTS)
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_that_the_system_does_not_read():
    """A process's memory is a regular file, whose first byte nobody may read."""
    memory = Path("/proc/self/mem")
    assert first_row(memory) == ""
    with pytest.raises(InputError, match=r"mem: cannot be read: .*; expected a table of frame"):
        read_table(memory, ("frame",))


def test_gaze_postures_in_any_columns_and_order(tmp_path):
    (tmp_path / "gaze.csv").write_text("name,vergence_deg,yaw_deg, pitch_deg\na,20,-90,45\n\nb,10,0,0\n")
    expected = [[-np.pi / 2, np.pi / 4, np.pi / 9], [0, 0, np.pi / 18]]
    np.testing.assert_allclose(read_gaze(tmp_path / "gaze.csv"), expected)
    (tmp_path / "gaze.csv").write_text("yaw_deg,pitch_deg,vergence_deg\nnan,NaN,180\n")
    np.testing.assert_allclose(read_gaze(tmp_path / "gaze.csv"), [[np.nan, np.nan, np.pi]])
    (tmp_path / "gaze.csv").write_text("yaw_deg,pitch_deg,vergence_deg\n")
    assert read_gaze(tmp_path / "gaze.csv").shape == (0, 3)


def test_numbers_of_a_row_are_finite_or_missing():
    np.testing.assert_array_equal(numbers(Path("a.csv"), 3, ["1.5", "", "NaN"]), [1.5, np.nan, np.nan])
    for word in ("inf", "x", "1_0"):
        with pytest.raises(InputError, match=rf"a\.csv:3: .*{word}.*; expected finite numbers"):
            numbers(Path("a.csv"), 3, ["1", word])


def test_reachability_is_in_degrees_and_with_a_track(tmp_path):
    reach = Reachability(0.5, np.deg2rad([10.0, -20.0, 30.0]), 0.75, 0.5, ReachStatus.REACHABLE)
    row = trajectory_row(Track3D.unknown(0.5), reach)
    assert len(row) == len(TRAJECTORY) + len(REACHABILITY)
    assert row[len(TRAJECTORY) : -3] == pytest.approx((10, -20, 30))
    assert row[-3:] == (0.75, 0.5, "reachable")
    write_reachability(tmp_path / "a.csv", [(1.0, 2.0, 3.0, True, 0.5, np.nan), (1.0, 2.0, 3.0, np.False_, 0.5, 1)])
    rows = (tmp_path / "a.csv").read_text()
    assert rows == (
        "yaw_deg,pitch_deg,vergence_deg,reachable,probability,degree\n1.0,2.0,3.0,1,0.5,\n1.0,2.0,3.0,0,0.5,1\n"
    )
