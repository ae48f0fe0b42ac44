"""Progress of a long command on standard error: a bar on a terminal, a line now and then in a log."""

import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

_EVERY_S = 10.0  # between two lines of a log
_LINE = "{desc}: {n_fmt} of {total_fmt} after {elapsed}"


class _Log:
    """Standard error as tqdm's file: every update becomes a new line."""

    def write(self, text: str) -> None:
        """Write the text as a line, unless it only erases one."""
        if line := text.strip():
            print(line, file=sys.stderr)

    def flush(self) -> None:
        """Flush standard error."""
        sys.stderr.flush()


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
    as_lines: dict[str, Any] = {"file": _Log(), "bar_format": _LINE, "leave": False}
    return tqdm(items, desc, total, mininterval=_EVERY_S, miniters=1, delay=after_s, **as_lines)
