"""Tables between markers of a document."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.experiments.tables import Table, estimate, fill, markdown, names

TEXT = "a\n<!-- table: one -->\nold | row\n<!-- end -->\nb\n<!-- table: two -->\nkept\n<!-- end -->\n"


def test_only_what_stands_between_the_markers_changes(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(TEXT)
    assert names(TEXT) == ["one", "two"]
    fill(file, {"one": markdown(Table(["what", "mm"], [["ball", "1"]]))})
    filled = file.read_text()
    assert filled == TEXT.replace("old | row\n", "| what | mm |\n| --- | ---: |\n| ball | 1 |\n")
    fill(file, {"one": markdown(Table(["what", "mm"], [["ball", "1"]]))})
    assert file.read_text() == filled


def test_a_marker_without_end_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text("<!-- table: one -->\n| what |\n")
    with pytest.raises(InputError, match=r"page\.md.*without its end"):
        fill(file, {"one": ""})


def test_an_estimate_shows_its_interval() -> None:
    assert estimate([1.2345, 1, 2.71828]) == "1.23 (1–2.72)"
    assert estimate([None, None, None]) == "–"
    assert estimate([3.0]) == "3"
