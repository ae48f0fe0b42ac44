"""Outputs that appear whole or not at all: written under a temporary name, then renamed."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from pps_vision.recordings.problems import BadInput, first_line


@contextmanager
def whole_folder(folder: Path, results: Collection[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files become those of `folder` when the block ends; it vanishes if it fails.

    `results` names the files a run may write: where `folder` exists, an earlier run's are replaced
    or removed and everything else in it stays.  Without names it must be new or empty.
    Entering is the check: BadInput if the place cannot be written.
    """
    final = folder.resolve()
    if final.exists() and not final.is_dir():
        raise BadInput(folder, "is a file; expected a folder to write to")
    present = sorted(os.listdir(final)) if final.exists() else []
    if present and not results:
        raise BadInput(folder, f"already holds {present[0]}; expected a new or empty folder to write to")
    partial = _beside(final, "partial")
    try:
        partial.mkdir(parents=True)
        if final.exists() and not os.access(final, os.W_OK | os.X_OK):
            raise PermissionError("Permission denied")
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise BadInput(folder, f"cannot be written: {first_line(error)}; expected a writable place") from error
    try:
        yield partial
        if not present:
            partial.replace(final)
            return
        for name in results:
            if (partial / name).exists():
                (partial / name).replace(final / name)
            else:
                (final / name).unlink(missing_ok=True)
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
