"""YAML of mappings, lists and scalars, read by PyYAML."""

from pathlib import Path
from typing import Any

import yaml

from pps_vision.errors import InputError

_MAX_DEPTH = 16


def parse_yaml(file: Path, text: str) -> Any:
    """Return a YAML document as dicts, lists and text, None if it is empty; scalars stay as written (`1e-05`, `1:30`).

    Raises:
        InputError: The text is no YAML, has anchors, aliases, tags, repeated keys or several documents, or is nested
            more than 16 levels deep. The message names the line.
    """
    try:
        _refuse_anchors_tags_and_depth(file, text)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.reader.ReaderError as error:
        raise _not_yaml(file, error.reason, text.count("\n", 0, error.position)) from error
    except yaml.MarkedYAMLError as error:
        raise _not_yaml(file, error.problem, (error.problem_mark or error.context_mark).line) from error
    return None if node is None else _content(file, node)


def _refuse_anchors_tags_and_depth(file: Path, text: str) -> None:
    """Without aliases no text grows when it is read; without depth the recursion ends."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) or getattr(event, "tag", None):
            raise _not_yaml(file, "an anchor, alias or tag", event.start_mark.line)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            raise _not_yaml(file, f"more than {_MAX_DEPTH} levels", event.start_mark.line)


def _content(file: Path, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return [_content(file, item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        return str(node.value)
    entries: dict[str, Any] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.value in entries:
            reason = f"{key.value} again" if isinstance(key, yaml.ScalarNode) else "a collection as a key"
            raise _not_yaml(file, reason, key.start_mark.line)
        entries[key.value] = _content(file, value)
    return entries


def _not_yaml(file: Path, reason: str, line: int) -> InputError:
    """The error of a line that is counted from 0."""
    expected = "expected YAML of mappings, lists, numbers and words, each key once"
    return InputError(file, f"cannot be parsed: {reason}; {expected}", line + 1)
