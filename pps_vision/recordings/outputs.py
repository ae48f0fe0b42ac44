"""Outputs that appear whole or not at all: written under a temporary name, then renamed."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from pps_vision.recordings.problems import BadInput, first_line


@contextmanager
def whole_folder(folder: Path, replaceable: Collection[str] = ()) -> Iterator[Path]:
    """A temporary folder that becomes `folder` when the block ends, and vanishes if it fails.

    Entering is the check: BadInput if the place cannot be written, or if `folder` already holds
    anything but the names in `replaceable`, which are replaced together.
    """
    final = folder.resolve()
    if final.exists() and not final.is_dir():
        raise BadInput(folder, "is a file; expected a folder to write to")
    foreign = sorted(set(os.listdir(final)) - set(replaceable)) if final.exists() else []
    if foreign:
        raise BadInput(folder, f"already holds {foreign[0]}; expected a new or empty folder to write to")
    partial, previous = _beside(final, "partial"), _beside(final, "previous")
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise BadInput(folder, f"cannot be written: {first_line(error)}; expected a writable place") from error
    try:
        yield partial
        if final.exists():
            final.rename(previous)
        partial.rename(final)
        shutil.rmtree(previous, ignore_errors=True)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def whole_file(file: Path) -> Iterator[Path]:
    """A temporary file that becomes `file` when the block ends, and vanishes if it fails.

    Entering is the check: BadInput if the place cannot be written.  An older file is replaced.
    """
    final = file.resolve()
    if final.is_dir():
        raise BadInput(file, "is a folder; expected a file to write to")
    partial = _beside(final, "partial").with_suffix(final.suffix)  # writers choose a format by suffix
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        partial.touch(exist_ok=False)
    except OSError as error:
        raise BadInput(file, f"cannot be written: {first_line(error)}; expected a writable place") from error
    try:
        yield partial
        partial.replace(final)
    finally:
        partial.unlink(missing_ok=True)


def _beside(final: Path, what: str) -> Path:
    """A hidden name in the same folder, this process's own."""
    return final.with_name(f".{final.name}.{os.getpid()}.{what}")
