"""Outputs that appear whole or not at all: written under a temporary name, then renamed."""

import json
import math
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError, first_line


@contextmanager
def whole_folder(folder: Path, results: Collection[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files become those of `folder` when the block ends; it vanishes if it fails.

    `results` names the files a run may write: where `folder` exists, an earlier run's are replaced
    or removed and everything else in it stays.  Without names it must be new or empty.
    An existing folder is never replaced: a shell may stand in it, or a disk be mounted there.
    Entering is the check: InputError if the place cannot be written.
    """
    final = folder.resolve()
    if final.exists() and not final.is_dir():
        raise InputError(folder, "is a file; expected a folder to write to")
    exists = final.exists()
    partial = _beside(final / "out" if exists else final, "partial")
    try:
        present = sorted(os.listdir(final)) if exists else []
        partial.mkdir(parents=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written: {first_line(error)}; expected a writable place") from error
    try:
        if present and not results:
            raise InputError(folder, f"already holds {present[0]}; expected a new or empty folder to write to")
        for name in results:
            if (final / name).is_dir():
                raise InputError(final / name, "is a folder; expected none where a file is to be written")
        yield partial
        if not exists:
            partial.replace(final)
            return
        written = [file.name for file in partial.iterdir()]
        for name in written:
            (partial / name).replace(final / name)
        for name in set(results).difference(written):
            (final / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def whole_file(file: Path) -> Iterator[Path]:
    """A temporary file that becomes `file` when the block ends, and vanishes if it fails.

    Entering is the check: InputError if the place cannot be written.  An older file is replaced.
    """
    final = file.resolve()
    if final.is_dir():
        raise InputError(file, "is a folder; expected a file to write to")
    partial = _beside(final, "partial").with_suffix(final.suffix)  # writers choose a format by suffix
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        partial.touch(exist_ok=False)
    except OSError as error:
        raise InputError(file, f"cannot be written: {first_line(error)}; expected a writable place") from error
    try:
        yield partial
        partial.replace(final)
    finally:
        partial.unlink(missing_ok=True)


def _beside(final: Path, what: str) -> Path:
    """A hidden name in the same folder, this process's own."""
    return final.with_name(f".{final.name}.{os.getpid()}.{what}")


def write_json(file: Path, content: Mapping[str, object]) -> None:
    """Write JSON: NumPy numbers, arrays and paths as plain ones, NaN and infinity as null."""
    file.write_text(json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def plain(value: object) -> object:
    """A value as JSON holds it."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
