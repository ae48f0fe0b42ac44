"""Generated tables in documents, between `<!-- table: NAME -->` and `<!-- end -->`."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pps_vision.errors import InputError

_MARKED = re.compile(r"(<!-- table: (\S+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


class Table(NamedTuple):
    """Column names and rows of cells."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def markdown(table: Table) -> str:
    """Return a table as Markdown; the first column is aligned left, the others right."""
    lines = [table.header, ["---", *["---:"] * (len(table.header) - 1)], *table.rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def estimate(numbers: Sequence[float | None], digits: int = 3) -> str:
    """Return [value, low, high] as "value (low–high)"; a dash where there is no value."""
    texts = ["–" if number is None or number != number else f"{number:.{digits}g}" for number in numbers]
    return texts[0] if texts[0] == "–" or len(texts) == 1 else f"{texts[0]} ({texts[1]}–{texts[2]})"


def read_numbers(file: Path) -> dict[str, Any]:
    """Return the numbers of a result file, nothing where there is none; null in a list becomes NaN.

    Raises:
        InputError: The file is no JSON object.
    """
    try:
        numbers = _not_measured(json.loads(file.read_text())) if file.exists() else {}
    except ValueError as error:
        raise InputError(file, f"{error}; expected the JSON of a study's results") from error
    if not isinstance(numbers, dict):
        raise InputError(file, f"a {type(numbers).__name__}; expected the JSON object of a study's results")
    return numbers


def _not_measured(value: Any) -> Any:
    """A value from JSON with NaN in place of each null in a list, which stands for an unmeasured value."""
    if isinstance(value, dict):
        return {key: _not_measured(x) for key, x in value.items()}
    if isinstance(value, list):
        return [math.nan if x is None else _not_measured(x) for x in value]
    return value


def judged(text: str, missed: bool) -> str:
    """Return a number's text, in bold where its goal is missed."""
    return f"**{text}**" if missed else text


def names(text: str) -> list[str]:
    """Return the names of the tables that a document asks for."""
    return [match[2] for match in _MARKED.finditer(text)]


def filled(text: str, tables: Mapping[str, str], document: Path) -> str:
    """Return a document's text with the tables between its markers; one that is not given stays unchanged.

    Raises:
        InputError: A marker of the `document` has no end.
    """
    if text.count("<!-- table:") != len(names(text)):
        raise InputError(
            document, "a marker `<!-- table: NAME -->` without its end; expected `<!-- end -->` after each"
        )
    return _MARKED.sub(lambda match: match[1] + tables.get(match[2], match[3]) + match[4], text)
