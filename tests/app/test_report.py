"""The report of a tracked recording and of a batch: made from files alone, complete, and whole in one page."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from results import write_results

from pps_vision.app.batch import TRACK_TABLE
from pps_vision.app.cli import main
from pps_vision.app.report import page
from pps_vision.app.report.tracking import read_tracked, report_folder
from pps_vision.recordings.tables import write_table


def test_a_report_shows_what_the_files_hold(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "results")
    assert report_folder(folder) == 1
    text = (folder / "report.html").read_text()
    warned = text.index("lost 1 times")
    assert warned < text.index("<img") < text.index("<canvas")
    assert text.index("try a &lt;longer&gt; baseline") < text.index("<img")
    assert text.count('src="data:image/') == 5  # two key frames, tracks in the images, figures over time, the skin
    assert "<td>reach: reachable</td><td>40</td>" in text
    assert "pps-vision track rec --seed 3 --out out" in text
    assert "numpy" in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert not re.search(r"https?://|@import|url\(", text)
    tracked = read_tracked(folder)
    assert len(tracked.truth) == len(tracked.stamps_s)
    assert np.isnan(tracked.position[0]).all()
    assert list(tracked.activation) == ["arm:1", "arm:2", "hand:1"]
    np.testing.assert_allclose(tracked.activation["arm:2"], np.arange(40) / 40)
    np.testing.assert_allclose(tracked.reach, np.arange(40) / 40)


def test_a_report_without_memory_and_map(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "results")
    (folder / "activation.csv").unlink()
    report_folder(folder)
    assert "Activation over the body" not in (folder / "report.html").read_text()


def test_activations_of_another_run(tmp_path: Path, refused) -> None:
    folder = write_results(tmp_path / "results")
    (folder / "activation.csv").write_text("stamp_s,arm:1\n0.0,0.5\n")
    assert "activation.csv: 1 rows; expected the 40" in refused("report", folder)


def test_colours_that_stand_for_times_have_a_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(page, "image", lambda figure: figures.append(figure) or "")
    report_folder(write_results(tmp_path / "results"))
    (in_images,) = (one for one in figures if one.axes[0].get_xlabel() == "u (px)")
    assert [axis.get_ylabel() for axis in in_images.axes] == ["v (px)", "v (px)", "time (s)", "time (s)"]


def test_the_report_of_a_batch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_results(tmp_path / "a")
    rows = [("a", "done", 40, 40, 0.925, "", 1.5, ""), ("b<c>", "failed", "", "", "", "", "", "cannot be read")]
    write_table(tmp_path / "batch.csv", list(TRACK_TABLE), rows)
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
