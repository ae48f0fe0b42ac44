"""Progress of a long command on standard error: a bar on a terminal, a line now and then in a log."""

import sys
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

from tqdm import tqdm

_EVERY_S = 10.0  # between two lines of a log
_LINE = "{desc}: {n_fmt} of {total_fmt} after {elapsed}"


def progress(
    items: Iterable[Any] | None = None,
    desc: str = "",
    unit: str = "it",
    total: int | None = None,
    after_s: float = _EVERY_S,
) -> "tqdm[Any]":
    """Return tqdm about `items`, or one that `update` advances.

    Where standard error is no terminal it prints a line every ten seconds, the first after `after_s`; what ends sooner
    prints none.
    """
    if sys.stderr.isatty():
        return tqdm(items, desc, total, unit=unit)
    lines = SimpleNamespace(write=_write_line, flush=lambda: sys.stderr.flush())
    log: dict[str, Any] = {"file": lines, "bar_format": _LINE, "leave": False}
    return tqdm(items, desc, total, mininterval=_EVERY_S, miniters=1, delay=after_s, **log)


def _write_line(text: str) -> None:
    """Write a text of tqdm's as a new line, unless it only erases one."""
    if line := text.strip():
        print(line, file=sys.stderr)
