"""The one exception for bad input; any package may raise it."""

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

_HALF = 300  # characters of a message; a file's content may be quoted in it


class InputError(ValueError):
    """Input that cannot be used.  Its message is one line, "SOURCE:LINE: problem; expected …".

    Args:
        source: The file, folder or command that the input came from.
        message: The problem and the expected input.
        line: The line of the file, from 1.
    """

    def __init__(self, source: Path | str, message: str, line: int | None = None) -> None:
        super().__init__(source, message, line)

    def __str__(self) -> str:
        source, message, line = self.args
        return cite(source, line, message)


def expect_positive(source: str, params: Any) -> None:
    """InputError for a field of a dataclass that is a number and not more than 0."""
    for field in fields(params):
        if isinstance(value := getattr(params, field.name), int | float) and not value > 0:
            raise InputError(source, f"{field.name} {value}; expected more than 0")


def expect_kinds(source: str, values: Mapping[str, Any], kinds: Mapping[str, Any]) -> None:
    """InputError for an argument that is not of its annotation in `kinds`, and for a negative seed.

    NumPy's numbers stand for Python's, lists and arrays for tuples; a truth value is no number.
    """
    from typeguard import ForwardRefPolicy, TypeCheckError, check_type

    for name, value in values.items():
        kind = kinds.get(name, Any)
        words = kind.__name__ if isinstance(kind, type) else re.sub(r"\b(?:\w+\.)+(?=\w)", "", str(kind))
        plain: Any = value.tolist() if hasattr(value, "tolist") else value
        plain = tuple(plain) if isinstance(plain, list) else plain
        try:
            if isinstance(plain, bool) and re.search("int|float", words):
                raise TypeCheckError("a truth value")
            check_type(plain, kind, forward_ref_policy=ForwardRefPolicy.IGNORE)
        except TypeCheckError as error:
            raise InputError(source, f"{name} {value!r}; expected {words}") from error
        if name == "seed" and plain < 0:
            raise InputError(source, f"seed {value}; expected a number of at least 0")


def cite(source: Path | str, line: int | None, message: str) -> str:
    """Return "SOURCE:LINE: message" on one line; a long message is cut in the middle."""
    where = f"{source}" if line is None else f"{source}:{line}"
    words = " ".join(message.splitlines())
    if len(words) > 2 * _HALF:
        words = f"{words[:_HALF]} … {words[-_HALF:]}"
    return " ".join(f"{where}: {words}".splitlines())


def first_line(error: Exception) -> str:
    """The message of an exception on one line; for an OSError, the system's message."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())
