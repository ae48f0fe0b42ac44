"""Tables between markers of a document."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import (
    Table,
    filled,
    markdown,
    names,
    read_numbers,
)

KNOWN, DOCS = catalogue(), Path(__file__).parents[2] / "docs"
TEXT = "a\n<!-- table: one -->\nold | row\n<!-- end -->\nb\n<!-- table: two -->\nkept\n<!-- end -->\n"


PAGE = Path("page.md")


def test_only_what_stands_between_the_markers_changes() -> None:
    assert names(TEXT) == ["one", "two"]
    tables = {"one": markdown(Table(["what", "mm"], [["ball", "1"]]))}
    new = filled(TEXT, tables, PAGE)
    assert new == TEXT.replace("old | row\n", "| what | mm |\n| --- | ---: |\n| ball | 1 |\n")
    assert filled(new, tables, PAGE) == new


def test_a_marker_without_end_is_refused() -> None:
    with pytest.raises(InputError, match=r"page\.md.*without its end"):
        filled("<!-- table: one -->\n| what |\n", {"one": ""}, PAGE)


@pytest.mark.parametrize("study", KNOWN)
def test_the_documents_hold_the_tables_that_follow_from_the_results(study: str) -> None:
    """As `bench --redraw` fills them."""
    numbers = read_numbers(DOCS / "results" / f"{study}.json")
    tables = KNOWN[study]().tables(numbers)
    made = {f"{study}_{part}" if part else study: markdown(table) for part, table in tables.items()}
    for document in (*DOCS.glob("*.md"), DOCS.parent / "README.md"):
        text = document.read_text()
        assert filled(text, made, document) == text
