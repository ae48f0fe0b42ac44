"""Arrays in a versioned .npz file without pickle, written whole or not at all."""

import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.errors import InputError

# What NumPy and the zip reader under it raise for a file that is damaged or no .npz at all.
UNREADABLE = (
    *(OSError, ValueError, EOFError, AttributeError, TypeError, KeyError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)


def write_archive(path: Path, kind: str, version: int, arrays: dict[str, ArrayLike]) -> None:
    """Write to a temporary name beside `path`, then rename."""
    contents: dict[str, Any] = {"kind": np.array(kind), "version": np.array(version), **arrays}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.savez_compressed(file, **contents)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_archive(path: Path, kind: str, version: int, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    """The named arrays; InputError that names the file and what is wrong with it."""
    try:
        with np.load(path) as file:
            present = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(path, f"no such file; expected a {kind} (.npz)") from None
    except UNREADABLE as error:
        raise InputError(path, f"is not a readable .npz file; expected a {kind}") from error
    if "kind" not in present or str(present["kind"]) != kind:
        raise InputError(path, f"is not a {kind}")
    if "version" not in present or str(present["version"]) != str(version):
        raise InputError(path, f"{kind} of version {present.get('version', 'unknown')}; expected version {version}")
    missing = [name for name in names if name not in present]
    if missing:
        raise InputError(path, f"{kind} without {', '.join(missing)}")
    return {name: present[name] for name in names}
