"""The report of a tracked recording and of a batch: made from files alone, complete, and whole in one page."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from results import write_results
from videos import write_video

from pps_vision.app.cli import main
from pps_vision.app.report.tracking import read_tracked, report_folder


def test_a_report_shows_what_the_files_hold(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "results")
    assert report_folder(folder) == 1
    text = (folder / "report.html").read_text()
    warned = text.index("lost 1 times")
    assert warned < text.index("<img") < text.index("<canvas")
    assert text.index("try a &lt;longer&gt; baseline") < text.index("<img")
    assert text.count('src="data:image/') == 4  # two key frames, tracks in the images, figures over time
    assert "pps-vision track rec --seed 3 --out out" in text
    assert "numpy" in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert not re.search(r"https?://|@import|url\(", text)
    tracked = read_tracked(folder)
    assert len(tracked.truth) == len(tracked.stamps_s)
    assert np.isnan(tracked.position[0]).all()


def test_track_and_batch_write_reports(tmp_path: Path, calib: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(4)])
    (tmp_path / "b.mp4").write_bytes(b"no video")
    out = tmp_path / "out"
    main(["batch", str(tmp_path / "*.mp4"), "--calib", str(calib), "--report", "--out", str(out)])
    page = (out / "report.html").read_text()
    assert page.index("b.mp4 failed: ") < page.index("<table")
    assert 'href="a.mp4/report.html"' in page
    assert "measured in 0 % of 4 pairs only" in page
    one = out / "a.mp4"
    frames = sorted((one / "keyframes").glob("*.jpg"))
    assert len(frames) == 4
    assert cv2.imread(str(frames[0])).shape == (240, 320, 3)
    before = (one / "report.html").read_text()
    (one / "report.html").unlink()
    main(["report", str(out)])
    assert (one / "report.html").read_text() == before
    assert "1 recordings →" in capsys.readouterr().out
    assert "No position is known" in before
    assert "--calib" in before


def test_what_holds_no_results(tmp_path: Path, refused) -> None:
    assert "summary.json" in refused("report", tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    assert "of another command" in refused("report", tmp_path)
    (tmp_path / "summary.json").write_text("{")
    assert "expected the summary" in refused("report", tmp_path)
