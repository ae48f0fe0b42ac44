"""The report of a tracked recording and of a batch: made from files alone, complete, and whole in one page."""

import re
from pathlib import Path

import numpy as np
import pytest
from results import write_results

from pps_vision.app.batch import TABLE
from pps_vision.app.cli import main
from pps_vision.app.report.tracking import read_tracked, report_folder
from pps_vision.recordings.tables import write_table


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


def test_the_report_of_a_batch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_results(tmp_path / "a")
    rows = [("a", "done", 40, 40, 0.925, "", 1.5, ""), ("b<c>", "failed", "", "", "", "", "", "cannot be read")]
    write_table(tmp_path / "batch.csv", TABLE, rows)
    main(["report", str(tmp_path)])
    page = (tmp_path / "report.html").read_text()
    assert page.index("b&lt;c&gt; failed: cannot be read") < page.index("a: lost 1 times") < page.index("<table")
    assert 'href="a/report.html"' in page
    assert (tmp_path / "a" / "report.html").is_file()
    assert "1 recordings →" in capsys.readouterr().out


def test_what_holds_no_results(tmp_path: Path, refused) -> None:
    assert "summary.json" in refused("report", tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    assert "of another command" in refused("report", tmp_path)
    (tmp_path / "summary.json").write_text("{")
    assert "expected the summary" in refused("report", tmp_path)
