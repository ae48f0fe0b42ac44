"""The part of YAML that calibrations are written in.

Block mappings and sequences, flow ones (over several lines as well), quoted and plain scalars, comments and `---` at
the start.  Anchors, tags, block scalars and several documents are refused, so that no text grows when it is read.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from pps_vision.errors import InputError
from pps_vision.recordings.text import number

_DEEPEST = 16
_KEY = re.compile(r"""(?:"([^"]*)"|'([^']*)'|([^\s"'\[\]{},#&*!|>%@`-][^:]*?|-[^\s:][^:]*?))\s*:(?:\s+(.*))?$""")
_TOKEN = re.compile(r"""\s*(?:([\[\]{},])|("[^"]*"|'[^']*')(\s*:)?|([^\[\]{},"':\s][^\[\]{},:]*)(:(?=\s|$))?)""")
_QUOTED = re.compile(r""""[^"]*"|'[^']*'""")


@dataclass(slots=True)
class _Row:
    indent: int
    text: str
    line: int


def parse_yaml(file: Path, text: str) -> Any:
    """Return mappings, lists, floats and strings; InputError with the line of what is not of this part of YAML."""
    rows = _rows(file, text)
    if not rows:
        return None
    value, end = _Parser(file, rows).block(0, 0)
    if end < len(rows):
        _refuse(file, rows[end].line, rows[end].text)
    return value


def _refuse(file: Path, line: int, found: str) -> NoReturn:
    raise InputError(
        file, f"cannot be parsed: {found[:60]!r}; expected YAML of mappings, lists, numbers and words", line
    )


def _rows(file: Path, text: str) -> list[_Row]:
    """The lines without comments; those of one flow collection joined."""
    rows: list[_Row] = []
    depth = 0
    for line, raw in enumerate(text.splitlines(), start=1):
        plain = _QUOTED.sub(lambda quoted: "_" * len(quoted[0]), raw)  # of the same length, without signs
        comment = re.search(r"(?:^|\s)#", plain)
        end = comment.start() if comment else len(raw)
        content = raw[:end].rstrip()
        if not content.strip() or (content == "---" and not rows):
            continue
        bare = content.lstrip(" ")
        if "\t" in content[: len(content) - len(content.lstrip())]:
            _refuse(file, line, content)
        if depth:
            rows[-1].text += " " + bare
        else:
            rows.append(_Row(len(content) - len(bare), bare, line))
        depth += sum(plain.count(sign, 0, end) for sign in "[{") - sum(plain.count(sign, 0, end) for sign in "]}")
        if not 0 <= depth <= _DEEPEST:
            _refuse(file, line, content)
    if depth:
        _refuse(file, rows[-1].line, rows[-1].text)
    return rows


class _Parser:
    def __init__(self, file: Path, rows: list[_Row]) -> None:
        self.file, self.rows = file, rows

    def block(self, at: int, depth: int) -> tuple[Any, int]:
        """The value that begins in a row, and the row after it."""
        row = self.rows[at]
        if depth > _DEEPEST:
            _refuse(self.file, row.line, row.text)
        if row.text == "-" or row.text.startswith("- "):
            return self._sequence(at, depth)
        if not row.text.startswith(("[", "{")) and _KEY.match(row.text):
            return self._mapping(at, depth)
        return self._flow(row.text, row.line), at + 1

    def _sequence(self, at: int, depth: int) -> tuple[list[Any], int]:
        indent, items = self.rows[at].indent, []
        while at < len(self.rows) and self.rows[at].indent == indent and re.match(r"-( |$)", self.rows[at].text):
            row = self.rows[at]
            rest = row.text[1:].lstrip()
            if rest:  # the item begins in the row of its dash
                self.rows[at] = _Row(indent + len(row.text) - len(rest), rest, row.line)
                item, at = self.block(at, depth + 1)
            else:
                item, at = self._below(at + 1, indent + 1, depth)
            items.append(item)
        return items, at

    def _mapping(self, at: int, depth: int) -> tuple[dict[str, Any], int]:
        indent, entries = self.rows[at].indent, dict[str, Any]()
        while at < len(self.rows) and self.rows[at].indent == indent and (found := _KEY.match(self.rows[at].text)):
            row, key, rest = self.rows[at], next(filter(None, found.groups()[:3]), ""), found[4]
            if key in entries:
                raise InputError(self.file, f"{key} again; expected each key once", row.line)
            if rest:
                entries[key], at = self._flow(rest, row.line), at + 1
            else:  # a list may stand as far left as its key
                dashed = at + 1 < len(self.rows) and self.rows[at + 1].text.startswith("-")
                entries[key], at = self._below(at + 1, indent + (not dashed), depth)
        return entries, at

    def _below(self, at: int, least_indent: int, depth: int) -> tuple[Any, int]:
        """The block of the rows that are indented; None where there are none."""
        if at < len(self.rows) and self.rows[at].indent >= least_indent:
            return self.block(at, depth + 1)
        return None, at

    def _flow(self, text: str, line: int) -> Any:
        """A scalar, or collections in brackets."""
        if not text.startswith(("[", "{")):
            return self._scalar(text, line)
        open_ones: list[tuple[Any, str | None]] = []  # each collection around with the key that waits for its value
        value: Any = None
        key: str | None = None
        at, after_value = 0, False
        while at < len(text):
            token = _TOKEN.match(text, at)
            if token is None or (at and not open_ones):
                _refuse(self.file, line, text[at:])
            at = token.end()
            sign, quoted, colon, plain, plain_colon = token.groups()
            if sign in ("[", "{") and not after_value:
                open_ones.append(([] if sign == "[" else {}, key))
                key = None
                continue
            if sign == "," and after_value:
                after_value = False
                continue
            if sign in ("]", "}") and open_ones and isinstance(open_ones[-1][0], list) == (sign == "]") and key is None:
                value, key = open_ones.pop()
            elif sign or after_value:
                _refuse(self.file, line, text)
            elif colon or plain_colon:
                if key is not None or not isinstance(open_ones[-1][0], dict):
                    _refuse(self.file, line, text)
                key = quoted[1:-1] if quoted else plain.strip()
                continue
            else:
                value = quoted[1:-1] if quoted else self._scalar(plain.strip(), line)
            after_value = True
            if open_ones:
                around = open_ones[-1][0]
                if isinstance(around, list) and key is None:
                    around.append(value)
                elif isinstance(around, dict) and key is not None and key not in around:
                    around[key], key = value, None
                else:
                    _refuse(self.file, line, text)
        if open_ones:
            _refuse(self.file, line, text)
        return value

    def _scalar(self, text: str, line: int) -> float | str:
        if _QUOTED.fullmatch(text):
            return text[1:-1]
        if text[0] in "&*!|>%@`\"'[]{},#":
            _refuse(self.file, line, text)
        try:
            return number(text)
        except ValueError:
            return text
