"""The report of a tracked recording and of a batch: made from files alone, complete, and whole in one page."""

import base64
import hashlib
import json
import os
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

from results import ODD_NAMES, write_results

from pps_vision.app.batch import TRACK_TABLE
from pps_vision.app.cli import main
from pps_vision.app.report.tracking import report_folder, write_batch_report
from pps_vision.recordings.tables import write_table


def lines_of_path(text: str) -> list[list[object]]:
    """The points of every line of a report's 3D path."""
    data = re.search(r'id="path-data">(.*?)</script>', text)[1]
    return [line["points"] for line in json.loads(data)["lines"]]


def test_a_report_shows_what_the_files_hold(tmp_path):
    folder = write_results(tmp_path / "results")
    assert report_folder(folder) == "37 of 40 stereo pairs measured"
    text = (folder / "report.html").read_text()
    warned = text.index("lost 1 times")
    assert warned < text.index("<img") < text.index("<canvas")
    assert text.index("try a &lt;longer&gt; baseline") < text.index("<img")
    assert text.count('src="data:image/') == 5  # two key frames, tracks in the images, figures over time, the skin
    assert "<td>reach: reachable</td><td>40</td>" in text
    assert "pps-vision track rec --seed 3 --out out" in text
    track, truth = lines_of_path(text)
    assert (track[19], len(track), len(truth)) == (None, 39, 40)  # from the second pair on, lost in the 21st
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert not re.search(r"https?://|@import|url\(", text)
    (folder / "activation.csv").unlink()
    (folder / "source" / "truth.csv").unlink()
    report_folder(folder)
    text = (folder / "report.html").read_text()
    assert "Activation over the body" not in text
    assert len(lines_of_path(text)) == 1


def test_the_tables_of_a_report(tmp_path):
    """Numbers with four digits; unknown values are a dash or left out."""
    folder = write_results(tmp_path / "results")
    summary = json.loads((folder / "summary.json").read_text())
    summary["errors"] = {"position_rms_mm": 3.14159, "tracked_share": None}
    summary["cameras"] |= {"shift_mm": None}
    summary["ms_per_pair"]["draw"] = {"q25_ms": 2, "median_ms": 2.5, "q75_ms": 3, "runs": 9}
    summary["object"] = {"diameter_m": 0.06012, "low_95_m": 0.0581, "high_95_m": 0.06199}
    summary |= {"skipped": {"image": 3, "stamp": 0}, "warnings": ["l.mp4 ends early"]}
    summary["cameras"]["rotation_deg"] = 1.26
    (folder / "summary.json").write_text(json.dumps(summary))
    report_folder(folder)
    text = (folder / "report.html").read_text()
    rows = [re.findall("<t[dh]>(.*?)</t[dh]>", row) for row in re.findall("<tr>(.*?)</tr>", text)]
    start = rows.index(["", "value"])
    assert [row for row in rows[start:] if row[0] not in summary["versions"]] == [
        ["", "value"],
        *(["pairs " + status, str(n)] for status, n in summary["status"].items()),
        ["position_rms_mm", "3.142"],
        ["tracked_share", "–"],
        ["reach: max_fp", "0.001"],
        ["reach: reachable", "40"],
        ["cameras: rotation_deg", "1.26"],
        ["stage", "median", "lower quartile", "upper quartile", "runs"],
        ["total", "1.5", "1", "2", "40"],
        ["draw", "2.5", "2", "3", "9"],
        ["setting or package", "value"],
        ["mode", "generic"],
        ["seed", "3"],
        ["device", "–"],
    ]
    assert "37 of 40 stereo pairs measured (92 %), " in text
    assert "object 60.1 mm across (95 %: 58.1–62)</dd>" in text
    assert "<dt>How exact?</dt><dd>3.14 mm from the truth (RMS), by its own covariance ± " in text
    assert f"<title>{summary['source']}</title>" in text
    for warning in ("l.mp4 ends early", "skipped: 3 image", "cameras that are said to be fixed turned by 1.3°"):
        assert warning in text


def test_the_report_of_a_batch(tmp_path, capsys):
    write_results(tmp_path / "a")
    rows = [
        ("a", "done", 40, 40, 0.925, "", 1.5, "0.2.0", ""),
        ("b<c>", "failed", "", "", "", "", "", "", "cannot be read"),
    ]
    write_table(tmp_path / "batch.csv", list(TRACK_TABLE), rows)
    main(["report", str(tmp_path)])
    page = (tmp_path / "report.html").read_text()
    assert page.index("b&lt;c&gt; failed: cannot be read") < page.index("a: lost 1 times") < page.index("<table")
    assert 'href="a/report.html"' in page
    assert (tmp_path / "a" / "report.html").is_file()
    assert capsys.readouterr().out.startswith("1 of 2 recordings tracked → ")
    assert "<td>0.2.0</td>" in page
    assert page.count('src="data:image/png') == 1


def test_names_are_text_and_links_lead_to_files(tmp_path):
    for name in ODD_NAMES:
        (write_results(tmp_path / name) / "report.html").touch()
    rows = [(name, "done", 40, 40, 0.925, "", 1.5, "0.2.0", "") for name in ODD_NAMES]
    write_table(tmp_path / "batch.csv", list(TRACK_TABLE), rows)
    write_batch_report(tmp_path)
    page = html5(tmp_path / "report.html")
    links = [dict(attributes)["href"] for tag, attributes in page.tags if tag == "a"]
    assert [os.fsdecode(unquote_to_bytes(link)) for link in links] == [f"{name}/report.html" for name in ODD_NAMES]
    assert {urlsplit(link)._replace(path="") for link in links} == {urlsplit("")}
    expected = "html meta title style h1 h2 p ul li div table tr th td a img pre"
    assert {tag for tag, _ in page.tags} <= set(expected.split())
    assert "49" not in page.text


def test_no_script_runs_but_the_page_s_own(tmp_path):
    folder = write_results(tmp_path / "results")
    (folder / "keyframes" / "0.jpg").rename(folder / "keyframes" / '"><script>alert(1).jpg')
    report_folder(folder)
    page = html5(folder / "report.html")
    (policy,) = (dict(attributes)["content"] for tag, attributes in page.tags if "http-equiv" in dict(attributes))
    (allowed,) = re.findall("script-src 'sha256-(.*?)'", policy)
    assert policy.startswith("default-src 'none'")
    (script,) = page.scripts
    assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() == allowed


class Page(HTMLParser):
    """Tags with their attributes, executable scripts and text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, list[tuple[str, str | None]]]] = []
        self.scripts: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, attrs))

    def handle_data(self, data):
        if self.tags and self.tags[-1] == ("script", []) and self.lasttag == "script" and self.cdata_elem:
            self.scripts.append(data)
        elif self.cdata_elem is None:
            self.text += data


def html5(file: Path) -> Page:
    page = Page()
    page.feed(file.read_text())
    return page


def test_what_holds_no_results(tmp_path, refused):
    (tmp_path / "file").touch()
    for place in (tmp_path, tmp_path / "gone", tmp_path / "file"):
        line = refused("report", place)
        assert f"{place}: holds neither summary.json nor batch.csv; expected a folder that track or batch has" in line
    for content, message in (("{}", "missing"), ("{", "expected the summary"), ("[" * 9999, "expected the")):
        (tmp_path / "summary.json").write_text(content)
        assert message in refused("report", tmp_path)
