"""What `info` says of recordings whose stamps and cameras are known; versions that results name."""

import importlib.metadata
import json
import re
import shlex
from pathlib import Path

import av
import numpy as np
import pytest
from calibrations import store, write_calibration
from videos import write_video

from pps_vision.app.cli import main
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.testing import check_error


@pytest.fixture
def videos(tmp_path: Path) -> list[str]:
    """Two videos of 20 pairs a second with one gap of 0.2 s, the right one 15 ms late, cameras 12 units apart."""
    stamps = [0.05 * k + 0.15 * (k > 7) for k in range(20)]
    write_video(tmp_path / "l.mp4", stamps)
    write_video(tmp_path / "r.mp4", [t + 0.015 for t in stamps])
    K = np.array([[80.0, 0, 80], [0, 80, 60], [0, 0, 1]])
    store(tmp_path / "calib.yml", K1=K, K2=K, R=np.eye(3), T=np.array([-12.0, 0, 0]))
    files = {"left": "l.mp4", "right": "r.mp4", "calib": "calib.yml"}
    return [word for option, name in files.items() for word in (f"--{option}", str(tmp_path / name))]


def test_videos(videos, capsys):
    main(["info", *videos, "--unit-m", "0.01", "--json"])
    facts = json.loads(capsys.readouterr().out)
    assert (facts["pairs"], facts["image_size"], facts["robot"], facts["gaps"]) == (20, [160, 120], False, 1)
    assert facts["cameras_turn_deg"] == 0
    assert facts["pairs_per_s"] == pytest.approx(20)
    assert {"pps-vision", "python", "numpy"} <= set(facts["versions"])
    assert facts["duration_s"] == pytest.approx(1.1)
    assert facts["longest_interval_s"] == pytest.approx(0.2)
    assert (facts["skew_median_ms"], facts["skew_largest_ms"]) == pytest.approx((15, 15))
    assert facts["baseline_m"] == pytest.approx(0.12)
    assert facts["field_of_view_deg"] == pytest.approx(90, abs=0.01)
    warnings = "\n".join(facts["warnings"])
    assert "+15.0 ms" in warnings
    assert "1 intervals" in warnings
    assert "unit" not in warnings
    command = shlex.split(facts["command"])
    assert command == ["pps-vision", "track", *videos, "--unit-m", "0.01", "--out", "path"]


def test_an_implausible_unit_and_a_missing_calibration(videos, capsys):
    main(["info", *videos])
    out = capsys.readouterr().out
    proposed = "--unit-m 0.01 makes it 120 mm; --unit-m 0.0254 makes it 304.8 mm"
    assert f"--unit-m: the cameras are 12 m apart; {proposed}\n" in out
    assert out.splitlines()[-1].startswith("pps-vision track --left")
    main(["info", *videos[:4]])
    rows = capsys.readouterr().out.splitlines()
    assert "missing: calibration; expected one by --calib" in rows
    assert rows[-1].endswith(" --calib FILE --out path")


def test_a_laboratorys_own_test(approach, videos):
    (score,) = check_error([approach], rmse_mm=20)
    assert 0 < score.rmse_mm < 20
    assert (score.rows, score.rows - score.unknown) == (48, score.compared)
    said = rf"1 of 1 recordings: .*\n.* lost, {score.unknown} of 48 pairs without a position \(fails\)"
    with pytest.raises(AssertionError, match=said):
        check_error([approach], rmse_mm=score.rmse_mm / 2)
    recording = open_recording(left=videos[1:2], right=videos[3:4], calib=videos[5:6])
    with pytest.raises(InputError, match=r"holds no truth\.csv; expected one there or by truth"):
        check_error([recording], rmse_mm=1)


def test_a_robot_s_recording_has_stamps_of_its_own(approach, tmp_path, capsys):
    warning = f"--fps not used: {approach} has stamps of its own"
    main(["info", str(approach), "--fps", "30", "--json"])
    facts = json.loads(capsys.readouterr().out)
    assert (facts["robot"], facts["image_size"], facts["pairs"], facts["truth_rows"]) == (True, [320, 240], 48, 48)
    assert (facts["pairs_per_s"], facts["baseline_m"]) == pytest.approx((20, 0.068), rel=0.02)
    assert facts["touches"] > 0
    assert warning in facts["warnings"]
    main(["track", str(approach), "--fps", "30", "--out", str(tmp_path / "out")])
    assert f"warning: {warning}\n" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"] == [warning]


def test_version_and_versions(approach, tmp_path, capsys):
    main(["--version"])
    assert capsys.readouterr().out.startswith("pps-vision 0.")
    main(["track", str(approach), "--also", "tum", "--out", str(tmp_path / "out")])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["versions"]["av"] == av.__version__
    assert summary["versions"]["numpy"] == np.__version__
    said = capsys.readouterr().out
    assert re.match(r"\d\d of 48 pairs tracked, median .* mm across .* → ", said)
    paths = [str(tmp_path / "out" / f"trajectory.{suffix}") for suffix in ("csv", "tum")]
    main(["evaluate", *paths, str(approach / "truth.csv"), "--json"])
    csv, tum = json.loads(capsys.readouterr().out)
    written = importlib.metadata.version("pps-vision")
    assert csv["version"] == tum["version"] == summary["versions"]["pps-vision"] == written
    assert (tmp_path / "out" / "trajectory.tum").read_text().startswith(f"# pps-vision {written}: stamp_s ")
    assert json.loads((approach / "summary.json").read_text())["versions"]["pps-vision"] == written
    assert csv["rmse_mm"] == tum["rmse_mm"] == pytest.approx(summary["errors"]["position_rms_all_mm"], rel=0.5)


def test_one_cameras_video_is_not_called_one_of_both_for_another_calibration(refused, tmp_path):
    calib = write_calibration(tmp_path / "calib.yml", 80.0, (79.5, 59.5), (160, 120))
    video = write_video(tmp_path / "mono.mp4", [0.0, 0.05, 0.1])
    line = refused("info", video, "--calib", calib)
    assert f"mono.mp4: its whole frames are as large as the images of {calib}, not their halves; expected both" in line
    square = write_calibration(tmp_path / "other.yml", 80.0, (79.5, 79.5), (160, 160))
    line = refused("info", video, "--calib", square)
    assert "other.yml: calibrated for 160×160 pixels, images are 80×120; expected --crop" in line
