"""Outputs that appear whole or not at all: written under a temporary name, then renamed.

One rule for all commands.  Refused are an output that is also read, one that is no regular file (a device, a FIFO), a
folder that holds anything, and an output that another run is writing to.  The remains of a killed run are
removed by the next run with the same output.
"""

import errno
import fcntl
import glob
import json
import math
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError, first_line

BUSY = "another run is writing to it; expected one at a time"
"""Why an output is refused while it is being written."""

_unfinished: set[Path] = set()  # lock files and temporary folders of the outputs that this process is writing


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder that becomes `folder` when the block ends, and is removed if the block fails.

    An existing folder that is empty is replaced in one step.  Where it cannot be (a disk is mounted there, its place is
    not writable) or should not be (this process runs in it, as the shell that has started it), it is filled file by
    file; the next run with the same output finishes this if it was interrupted.

    InputError on entering if `folder` is refused (see above) or cannot be written.
    """
    final = _resolved(folder)
    if final.exists() and not final.is_dir():
        raise InputError(folder, "is no folder; expected a new or empty folder to write to")
    filled = final.exists() and not _is_replaceable(final)
    with _temporary_folder(folder, final.name, final if filled else final.parent) as partial:
        if filled:
            for finished in final.glob(f".{glob.escape(final.name)}.*.finished"):
                _fill(final, finished, folder)
        present = sorted(name for name in os.listdir(final) if not _is_ours(name, final.name)) if filled else []
        if present:
            raise InputError(folder, f"already holds {present[0]}; expected a new or empty folder to write to")
        yield partial
        if not filled:
            if final.exists():
                shutil.copymode(final, partial)
            _rename(partial, final, folder)
            return
        _fill(final, partial.rename(partial.with_suffix(".finished")), folder)


@contextmanager
def whole_file(file: Path, inputs: Iterable[Path | None] = ()) -> Iterator[Path]:
    """A temporary file that becomes `file` when the block ends, and vanishes if it fails.

    An older file is replaced, unless it is one of `inputs` or lies in one of them.  The temporary file has the same
    name, since writers choose a format by its suffix.

    InputError on entering if `file` is refused (see above) or cannot be written.
    """
    final = _resolved(file)
    if final.is_dir():
        raise InputError(file, "is a folder; expected a file to write to")
    if final.exists() and not final.is_file():
        raise InputError(file, "is no regular file; expected a file to write to")
    for source in filter(Path.exists, filter(None, inputs)):
        if final.exists() and (final.samefile(source) or source.resolve() in final.parents):
            raise InputError(file, f"belongs to {source}, which is read; expected another file to write to")
    with _temporary_folder(file, final.name, final.parent) as folder:
        yield folder / final.name
        _rename(folder / final.name, final, file)


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """A folder, made if it is not there, that no other process can lock until the block ends.

    InputError if another holds it, or the folder cannot be written.
    """
    place = _resolved(folder)
    if place.exists() and not place.is_dir():
        raise InputError(folder, "is no folder; expected a folder to write to")
    with _locked(place / ".lock", folder):
        yield


def _is_replaceable(folder: Path) -> bool:
    """Whether an existing folder is empty, and another can take its place unnoticed."""
    try:
        stands_in_it = Path.cwd().is_relative_to(folder)
    except FileNotFoundError:  # the working directory was removed
        stands_in_it = False
    writable = os.access(folder.parent, os.W_OK | os.X_OK)
    return writable and not (stands_in_it or os.path.ismount(folder) or os.listdir(folder))


def _fill(final: Path, finished: Path, output: Path) -> None:
    """Move all files of a finished folder to their place."""
    for file in list(finished.iterdir()):
        _rename(file, final / file.name, output)
    finished.rmdir()


def remove_unfinished() -> None:
    """Remove what this process has begun to write; for handlers of signals, after which nothing is written any more."""
    for path in _unfinished:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _resolved(path: Path) -> Path:
    try:
        final = path.resolve()
        if final.is_symlink():  # from Python 3.13 on `resolve` leaves a loop unresolved
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    except (OSError, RuntimeError) as error:  # up to Python 3.12 it is a RuntimeError
        raise _not_writable(path, error) from error
    return final


def _not_writable(output: Path, error: Exception, expected: str = "a writable place") -> InputError:
    return InputError(output, f"cannot be written: {first_line(error)}; expected {expected}")


@contextmanager
def _temporary_folder(output: Path, name: str, place: Path) -> Iterator[Path]:
    """A new hidden folder in `place` for the output of this name, which is locked until the block ends."""
    lock = place / f".{name}.lock"
    partial = place / f".{name}.{secrets.token_hex(4)}.partial"
    new = [folder for folder in (place, *place.parents) if not folder.exists()]
    try:
        with _locked(lock, output):
            _unfinished.update((lock, partial))
            try:
                for file in list(place.iterdir()):
                    if file != lock and _is_ours(file.name, name):  # left by a killed run: we hold the lock
                        shutil.rmtree(file, ignore_errors=True)
                partial.mkdir()
                yield partial
            finally:
                shutil.rmtree(partial, ignore_errors=True)
                _unfinished.difference_update((lock, partial))
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise _not_writable(output, error, "free space") from error
        raise
    finally:
        with suppress(OSError):
            for folder in new:
                folder.rmdir()  # which fails, as it should, where there is a result


def _is_ours(file: str, name: str) -> bool:
    """Whether this is the lock or a temporary folder of the output `name`."""
    return re.fullmatch(rf"\.{re.escape(name)}\.(lock|[0-9a-f]+\.partial)", file) is not None


@contextmanager
def _locked(lock: Path, output: Path) -> Iterator[None]:
    """Hold a lock file, in a folder that is made if it is not there; the system frees it even after kill -9."""
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        held = _lock(lock)
    except BlockingIOError as error:
        raise InputError(output, BUSY) from error
    except OSError as error:
        raise _not_writable(output, error) from error
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(held)


def _lock(lock: Path) -> int:
    """The descriptor of a lock file that this process holds; BlockingIOError if another does."""
    while True:
        held = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(held), lock.stat()):
                return held
        except FileNotFoundError:  # its holder has just ended and removed it: lock a new one
            pass
        except BlockingIOError:
            os.close(held)
            raise
        os.close(held)


def _rename(partial: Path, final: Path, output: Path) -> None:
    """Move the output to its place, or beside it if a file has appeared there."""
    try:
        partial.replace(final)
    except OSError as error:
        rescued = final.with_name(f"{final.stem}-{secrets.token_hex(4)}{final.suffix}")
        partial.replace(rescued)
        raise InputError(output, f"cannot be written: {first_line(error)}; the output is kept in {rescued}") from error


def write_json(file: Path, content: object) -> None:
    """Write `json_text`."""
    file.write_text(json_text(content) + "\n", encoding="utf-8", errors="backslashreplace")  # names hold any bytes


def json_text(content: object) -> str:
    """JSON: NumPy numbers, arrays and paths as plain ones, NaN and infinity as null."""
    return json.dumps(plain(content), indent=2, ensure_ascii=False)


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
