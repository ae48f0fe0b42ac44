"""The result files have the columns that were promised, and empty fields where nothing is known."""

import csv
import json
from pathlib import Path

import numpy as np

from pps_vision.recordings.results import write_boxes, write_detections, write_summary, write_trajectory
from pps_vision.types import Detection2D, Status, Track3D


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_detections(tmp_path: Path) -> None:
    file = tmp_path / "detections.csv"
    seen = Detection2D(
        1512784563.547172, "right", np.array([1 / 3, 2.0]), np.array([[4.0, 5], [5, 6]]), 0.5, 0.1, (0, 0, 1, 1)
    )
    write_detections(file, [(8, seen, Status.TRACKING)])
    assert file.read_text().splitlines()[0] == (
        "frame,stamp_s,camera,u_px,v_px,cov_uu_px2,cov_uv_px2,cov_vv_px2,score,status"
    )
    (row,) = rows_of(file)
    assert (row["frame"], row["camera"], row["status"]) == ("8", "right", "tracking")
    assert (float(row["stamp_s"]), float(row["u_px"]), float(row["v_px"])) == (1512784563.547172, 1 / 3, 2)
    assert (float(row["cov_uu_px2"]), float(row["cov_uv_px2"]), float(row["cov_vv_px2"])) == (4, 5, 6)


def test_trajectory(tmp_path: Path) -> None:
    file = tmp_path / "trajectory.csv"
    cov = np.zeros((12, 12))
    cov[:3, :3] = [[1, 2, 3], [2, 4, 5], [3, 5, 6]]
    known = Track3D(0.5, np.arange(12.0).reshape(4, 3), cov, 0.03, 1e-6, Status.COASTING)
    write_trajectory(file, [Track3D.unknown(0.0), known])
    assert file.read_text().splitlines()[0] == (
        "stamp_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,"
        "cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2,radius_m,status"
    )
    nothing, row = rows_of(file)
    assert nothing["x_m"] == nothing["cov_zz_m2"] == nothing["radius_m"] == ""
    assert nothing["status"] == "searching"
    assert [float(row[key]) for key in ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")] == [0, 1, 2, 3, 4, 5]
    assert [float(row[f"cov_{key}_m2"]) for key in ("xx", "xy", "xz", "yy", "yz", "zz")] == [1, 2, 3, 4, 5, 6]


def test_boxes(tmp_path: Path) -> None:
    write_boxes(tmp_path / "boxes.csv", [(1, (10.5, 20.0, 3.0, 4.0), 1.0)])
    assert (tmp_path / "boxes.csv").read_text() == "frame,x,y,w,h,score\n1,10.5,20.0,3.0,4.0,1.0\n"


def test_a_summary_is_json_that_any_reader_takes(tmp_path: Path) -> None:
    file = tmp_path / "summary.json"
    summary = {"n": np.int64(3), "ms": np.array([1.0, np.nan]), "error": float("inf"), "on": np.True_, "kind": (1, "σ")}
    write_summary(file, summary)
    assert json.loads(file.read_text()) == {"n": 3, "ms": [1.0, None], "error": None, "on": True, "kind": [1, "σ"]}
