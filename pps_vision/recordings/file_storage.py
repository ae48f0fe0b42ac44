"""OpenCV's file storage (XML, YAML or JSON), read without OpenCV, whose parsers may never return or end the process."""

import base64
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.calibration_files import parse_yaml

_EXPECTED = "expected OpenCV's XML, YAML or JSON"
_YAML_TAGS = ("tag:yaml.org,2002:opencv-matrix", "tag:yaml.org,2002:binary")
_WORDS = {".nan": "nan", ".inf": "inf", "-.inf": "-inf"}  # OpenCV's words for what is not finite
_BINARY_HEADER = 24  # bytes before the numbers of base64 data
_TYPES = {"d": "<f8", "f": "<f4", "i": "<i4", "s": "<i2", "w": "<u2", "c": "i1", "u": "u1"}


def read_file_storage(file: Path, text: str, names: Iterable[str]) -> dict[str, Any]:
    """Return the entries of these names that a file storage holds, numbers as words: one, or a list of them.

    Raises:
        InputError: The text is none of the three forms, or a matrix does not have its rows × cols numbers; names the
            line where the parser knows it.
    """
    if text.startswith("<"):
        content = _read_xml(file, text)
    elif text.startswith("{"):
        content = _read_json(file, text)
    else:
        content = parse_yaml(file, re.sub(r"^%YAML[^\n]*", "", text), _YAML_TAGS)
    if not isinstance(content, Mapping):
        raise InputError(file, f"cannot be parsed: no entries; {_EXPECTED}")
    entries = {name: content[name] for name in names if name in content}
    return {name: _data(file, name, entry) if isinstance(entry, Mapping) else entry for name, entry in entries.items()}


def _read_xml(file: Path, text: str) -> Any:
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):  # entities may grow without end
        raise InputError(file, f"cannot be parsed: a declaration <!…>; {_EXPECTED}")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise InputError(file, f"cannot be parsed: {first_line(error)}; {_EXPECTED}", line) from error
    return {
        node.tag: {part.tag: _words(part.text or "") for part in node} if len(node) else _words(node.text or "")
        for node in root
    }


def _read_json(file: Path, text: str) -> Any:
    try:
        return json.loads(text, parse_float=str, parse_int=str)
    except json.JSONDecodeError as error:
        raise InputError(file, f"cannot be parsed: {error.msg}; {_EXPECTED}", error.lineno) from error
    except RecursionError as error:
        raise InputError(file, f"cannot be parsed: too many levels; {_EXPECTED}") from error


def _words(text: str) -> list[str] | str:
    words = text.split()
    return words[0] if len(words) == 1 else words


def _data(file: Path, key: str, matrix: Mapping[str, Any]) -> Any:
    """The numbers of a matrix."""
    data = matrix.get("data", [])
    form = re.fullmatch(r"([0-9]*)([dfiswcu])", str(matrix.get("dt", "d")))
    try:
        size = int(matrix["rows"]) * int(matrix["cols"]) * int((form and form[1]) or 1)
        if form is None or size < 0:
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise InputError(file, f"{key} has no rows, cols and dt of a matrix; {_EXPECTED}") from None
    words = data if isinstance(data, list) else [data]
    if len(words) != size and (encoded := "".join(map(str, words)).removeprefix("$base64$")):
        try:
            raw = base64.b64decode("".join(encoded.split()), validate=True)[_BINARY_HEADER:]
            words = [str(number) for number in np.frombuffer(raw, _TYPES[form[2]]).tolist()]
        except ValueError:
            pass  # no base64 either
    if len(words) != size:
        raise InputError(file, f"{key} has {len(words)} numbers; expected {size}, its rows × cols")
    return [_WORDS.get(str(word).lower(), str(word)) for word in words]
