"""Files of entries, whatever their syntax: YAML, JSON, XML, TOML, INI, NumPy's .npz and MATLAB's .mat.

OpenCV's file storage is read without OpenCV, whose parsers may never return or end the process.
"""

import base64
import json
import re
import struct
import subprocess
import sys
import tomllib
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from configparser import ConfigParser
from configparser import Error as IniError
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from pps_vision.errors import InputError, first_line
from pps_vision.files import read_bytes
from pps_vision.recordings.text import finite
from pps_vision.types import Array

_MOST_CHARACTERS = 2**22
_MOST_NODES = 2000  # lists, tables and keys; of JSON more, which is read fast
_MOST_JSON_NODES = 2**16
_MOST_ARRAY_BYTES = 2**20  # of one in an .npz file, and of all in a .mat file; larger ones are left out
_MAX_DEPTH = 16  # levels of tables and lists
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C 15 times as fast: 4 s for 400 000 numbers
_LARGEST = 1e9  # of any number in a calibration; keeps products finite
_NODE = re.compile(r"[\[{:]|-\s|<(?![/!?])")  # what may open one in YAML or XML
_TOML_NODE = re.compile(r"[\[{=]|[A-Za-z_\"']\s*\.")  # dotted keys nest
_TABLE = re.compile(r"^[ \t]*\[[^\[\]]+\][ \t]*$", re.MULTILINE)  # [name] in TOML and INI
_YAML_TAGS = ("tag:yaml.org,2002:opencv-matrix", "tag:yaml.org,2002:binary")
_BINARY_HEADER = 24  # bytes before the numbers of base64 data
_TYPES = {"d": "<f8", "f": "<f4", "i": "<i4", "s": "<i2", "w": "<u2", "c": "i1", "u": "u1"}
_MAT_S = 60.0  # for one .mat file
_MATLAB_HINT = "expected a struct: s = toStruct(stereoParams); save('stereo.mat', 's', '-v7')"
_COMPRESSED = 15  # type of a compressed element in a .mat file


@dataclass(frozen=True)
class Document:
    """The entries of a file, or of a table in it: words, arrays, lists of these, and tables."""

    file: Path
    content: Mapping[str, Any]

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def word(self, key: str, default: str = "") -> str:
        """The entry as a word."""
        return str(self.content.get(key, default))

    def tables(self) -> dict[str, "Document"]:
        """All entries that are tables."""
        return {key: Document(self.file, value) for key, value in self.content.items() if isinstance(value, Mapping)}

    def table(self, key: str) -> "Document":
        """The entry as a table; InputError if it is none."""
        value = self.content.get(key)
        if not isinstance(value, Mapping):
            raise InputError(self.file, f"{key} is {str(value)[:60]!r}; expected the entries of a camera")
        return Document(self.file, value)

    def numbers(self, key: str, *shape: int) -> Array:
        """The finite numbers of an entry, of any number without a shape: a list, lists of rows, an array, or OpenCV's
        matrix {rows, cols, dt, data}; InputError if they are no numbers or of another number."""
        value = self.content.get(key)
        if isinstance(value, Mapping):
            value = _matrix(self.file, key, value) if "cols" in value else value.get("data")
        try:
            if isinstance(value, np.ndarray):
                value = value.ravel().tolist()
            items = value if isinstance(value, list) else [value]
            items = [item for row in items for item in (row if isinstance(row, list) else [row])]
            values = np.array([finite(str(item)) for item in items], dtype=float)
            if np.any(np.abs(values) > _LARGEST):
                raise ValueError
            return values.reshape(shape) if shape else values
        except ValueError:
            wanted = f"{'×'.join(map(str, shape))} numbers" if shape else "numbers"
            raise InputError(self.file, f"{key} is {str(value)[:80]}; expected {wanted}") from None

    def scalars(self, keys: Iterable[str], missing: float | None = None) -> Array:
        """The numbers of several entries; `missing` for absent ones, else InputError."""
        return np.array(
            [missing if missing is not None and key not in self else self.numbers(key, 1)[0] for key in keys]
        )


def read_document(file: Path) -> Document:
    """Return the entries of a file; InputError, with the line where it is known, for one of another kind."""
    data = read_bytes(file, "a calibration")
    if data.startswith(b"PK\x03\x04"):
        return Document(file, _read_npz(file))
    if data.startswith((b"MATLAB 5.0", b"\x89HDF")) or file.suffix == ".mat":
        return Document(file, _read_mat(file, data))
    text = data.decode("utf-8-sig", errors="replace")
    is_json = text.startswith("{")
    is_toml = not text.startswith(("<", "%YAML", "{")) and _TABLE.search(text) is not None
    nodes = _TOML_NODE if is_toml else _NODE
    most = _MOST_JSON_NODES if is_json else _MOST_NODES
    if len(text) > _MOST_CHARACTERS or len(nodes.findall(text)) > most:
        too_much = f"has more than {_MOST_CHARACTERS} characters or {most} nodes"
        raise InputError(file, f"{too_much}; expected a calibration")
    if text.startswith("<"):
        content = _read_xml(file, text)
    elif is_json:
        content = _read_json(file, text)
    elif is_toml and file.suffix in (".conf", ".ini"):
        content = _read_ini(file, text)
    elif is_toml:
        content = _read_toml(file, text)
    else:
        content = parse_yaml(file, re.sub(r"^%YAML[^\n]*|\n---\s*\Z", "", text), _YAML_TAGS)
    if not isinstance(content, Mapping):
        raise InputError(file, "cannot be parsed: no entries; expected XML, YAML, JSON or TOML of a calibration")
    _check_depth(file, content)
    return Document(file, content)


def _check_depth(file: Path, content: object) -> None:
    """InputError for tables and lists in more than 16 levels, at which readers that go down would fail."""
    level = [content]
    for _ in range(_MAX_DEPTH):
        parts = [
            item.values() if isinstance(item, Mapping) else item for item in level if isinstance(item, Mapping | list)
        ]
        level = [item for part in parts for item in part]
        if not level:
            return
    raise InputError(file, f"cannot be parsed: more than {_MAX_DEPTH} levels; expected a calibration")


def _read_xml(file: Path, text: str) -> Any:
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):  # entities may grow without end
        raise InputError(file, "cannot be parsed: a declaration <!…>; expected OpenCV's XML")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise InputError(file, f"cannot be parsed: {first_line(error)}; expected OpenCV's XML", line) from error
    return {
        node.tag: {part.tag: _words(part.text or "") for part in node} if len(node) else _words(node.text or "")
        for node in root
    }


def _words(text: str) -> list[str] | str:
    words = text.split()
    return words[0] if len(words) == 1 else words


def _read_json(file: Path, text: str) -> Any:
    try:
        return json.loads(text, parse_float=str, parse_int=str)
    except json.JSONDecodeError as error:
        raise InputError(file, f"cannot be parsed: {error.msg}; expected JSON", error.lineno) from error
    except RecursionError as error:
        raise InputError(file, "cannot be parsed: too many levels; expected JSON of a calibration") from error


def _read_toml(file: Path, text: str) -> Any:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of too many digits is a plain ValueError
        raise InputError(file, f"cannot be parsed: {first_line(error)}; expected TOML of a calibration") from error


def _read_ini(file: Path, text: str) -> Any:
    """Keys become lower case."""
    parser = ConfigParser(strict=False, interpolation=None, default_section="")
    try:
        parser.read_string(text)
    except IniError as error:
        raise InputError(file, f"cannot be parsed: {first_line(error)}; expected sections of key = value") from error
    return {name: dict(parser[name]) for name in parser.sections()}


def _read_npz(file: Path) -> dict[str, Any]:
    """Arrays of numbers; large ones and objects, which would be unpickled, are left out."""
    try:
        with zipfile.ZipFile(file) as archive, np.load(file, allow_pickle=False) as arrays:
            sizes = {entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()}
            content: dict[str, Any] = {}
            for name in arrays.files:
                if sizes.get(name, 0) <= _MOST_ARRAY_BYTES:
                    try:
                        array = arrays[name]
                    except ValueError:  # of objects
                        continue
                    content |= {name: array} if array.dtype.kind in "biuf" else {}
            return content
    except (ValueError, OSError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected an .npz file of matrices") from error


def _read_mat(file: Path, data: bytes) -> dict[str, Any]:
    """Variables; InputError with a remedy for MATLAB's objects, and for files of version 7.3."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if data.startswith(b"\x89HDF") or data[:30].startswith(b"MATLAB 7.3"):
        raise InputError(file, f"is of MATLAB's version 7.3; {_MATLAB_HINT}")
    if _inflated(data) > _MOST_ARRAY_BYTES:
        raise InputError(file, f"holds more than {_MOST_ARRAY_BYTES} bytes of variables; {_MATLAB_HINT}")
    if problem := _problem_of_mat(data):
        raise InputError(file, f"cannot be read: {problem}; {_MATLAB_HINT}")
    variables = loadmat(BytesIO(data), simplify_cells=True)
    objects = MatlabOpaque, MatlabObject, MatlabFunction
    plain = {
        name: value for name, value in variables.items() if not name.startswith("__") and not isinstance(value, objects)
    }
    if not plain:
        raise InputError(file, f"holds objects of MATLAB only; {_MATLAB_HINT}")
    return plain


def _problem_of_mat(data: bytes) -> str:
    """Why SciPy cannot read a .mat file, tried in another process, which damaged files crash; empty if it can."""
    read = "import io, sys, scipy.io; scipy.io.loadmat(io.BytesIO(sys.stdin.buffer.read()), simplify_cells=True)"
    try:
        tried = subprocess.run([sys.executable, "-P", "-c", read], input=data, capture_output=True, timeout=_MAT_S)
    except subprocess.TimeoutExpired:
        return f"it takes longer than {_MAT_S:g} s"
    if tried.returncode == 0:
        return ""
    said = tried.stderr.decode(errors="replace").strip().splitlines() if tried.returncode > 0 else []
    return (said[-1].partition(": ")[2] if said else "") or "it is damaged"


def _inflated(data: bytes) -> int:
    """Bytes of all variables of a .mat file, uncompressed, as far as the limit."""
    order = ">" if data[126:128] == b"MI" else "<"
    at, total = 128, 0
    while at + 8 <= len(data) and total <= _MOST_ARRAY_BYTES:
        kind, size = struct.unpack_from(f"{order}II", data, at)
        at += 8
        if kind == _COMPRESSED:
            try:
                total += len(zlib.decompressobj().decompress(data[at : at + size], _MOST_ARRAY_BYTES + 1))
            except zlib.error:
                return total  # the reader names the damage
        else:
            total += size
        at += size
    return total


def _matrix(file: Path, key: str, matrix: Mapping[str, Any]) -> list[str]:
    """The numbers of OpenCV's matrix."""
    data = matrix.get("data", [])
    form = re.fullmatch(r"([0-9]*)([dfiswcu])", str(matrix.get("dt", "d")))
    try:
        size = int(matrix["rows"]) * int(matrix["cols"]) * int((form and form[1]) or 1)
        if form is None or size < 0:
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise InputError(file, f"{key} has no rows, cols and dt of a matrix; expected OpenCV's matrix") from None
    words = data if isinstance(data, list) else [data]
    if len(words) != size and (encoded := "".join(map(str, words)).removeprefix("$base64$")):
        try:
            raw = base64.b64decode("".join(encoded.split()), validate=True)[_BINARY_HEADER:]
            words = [str(number) for number in np.frombuffer(raw, _TYPES[form[2]]).tolist()]
        except ValueError:
            pass  # no base64 either
    if len(words) != size:
        raise InputError(file, f"{key} has {len(words)} numbers; expected {size}, its rows × cols")
    return [str(word) for word in words]


def parse_yaml(file: Path, text: str, tags: Sequence[str] = ()) -> Any:
    """Return a YAML document as dicts, lists and text, None if it is empty; scalars stay as written (`1e-05`, `1:30`).
    InputError where the text is no YAML, has anchors, aliases, tags but `tags`, repeated keys or several documents, or
    is nested more than 16 levels deep. The message names the line."""
    try:
        _refuse_anchors_tags_and_depth(file, text, tags)
        node = yaml.compose(text, Loader=_LOADER)
    except yaml.reader.ReaderError as error:
        raise _not_yaml(file, error.reason, text.count("\n", 0, error.position)) from error
    except yaml.MarkedYAMLError as error:
        raise _not_yaml(file, error.problem, (error.problem_mark or error.context_mark).line) from error
    return None if node is None else _yaml_content(file, node)


def _refuse_anchors_tags_and_depth(file: Path, text: str, tags: Sequence[str]) -> None:
    """Without aliases no text grows when it is read; without depth the recursion ends."""
    depth = 0
    for event in yaml.parse(text, Loader=_LOADER):
        is_alias = isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None)
        if is_alias or (getattr(event, "tag", None) or None) not in (None, *tags):
            raise _not_yaml(file, "an anchor, alias or tag", event.start_mark.line)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            raise _not_yaml(file, f"more than {_MAX_DEPTH} levels", event.start_mark.line)


def _yaml_content(file: Path, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return [_yaml_content(file, item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        return str(node.value)
    entries: dict[str, Any] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.value in entries:
            reason = f"{key.value} again" if isinstance(key, yaml.ScalarNode) else "a collection as a key"
            raise _not_yaml(file, reason, key.start_mark.line)
        entries[key.value] = _yaml_content(file, value)
    return entries


def _not_yaml(file: Path, reason: str, line: int) -> InputError:
    """The error of a line that is counted from 0."""
    expected = "expected YAML of mappings, lists, numbers and words, each key once"
    return InputError(file, f"cannot be parsed: {reason}; {expected}", line + 1)
