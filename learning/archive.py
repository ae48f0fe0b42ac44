"""Arrays in .npz files without pickle, written whole or not at all."""

import os
import zipfile
import zlib
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.errors import InputError
from pps_vision.files import check_regular

_MOST_BYTES = 2**28

# Raised by NumPy and its zip reader for a file that is damaged or no .npz at all.
_UNREADABLE = (
    *(OSError, ValueError, EOFError, AttributeError, TypeError, KeyError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)


def write_archive(path: Path, kind: str, version: int, arrays: dict[str, ArrayLike]) -> None:
    """Write arrays, their kind, its version and that of this package to a temporary name beside `path`, then rename."""
    content: dict[str, Any] = {"kind": kind, "version": version, "written_by": metadata.version("pps-vision"), **arrays}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.savez_compressed(file, **content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_archive(path: Path, kind: str, version: int, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    """The named arrays of an archive of this kind and version, and `written_by`, the version of this package that wrote
    it; InputError for any other file."""
    header = _stored_arrays(path, kind, ("kind", "version", "written_by"))
    if str(header.get("kind")) != kind:
        raise InputError(path, f"is not a {kind}; expected one (.npz)")
    if str(header.get("version")) != str(version):
        raise InputError(path, f"{kind} of version {header.get('version', 'unknown')}; expected version {version}")
    return {**read_arrays(path, kind, names), "written_by": header.get("written_by", np.array("unknown"))}


def read_arrays(path: Path, content: str, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    """The named arrays of an .npz file, which should hold `content`; InputError if it cannot be read, lacks one, states
    more than 256 MiB of them, or one is not of real numbers or text."""
    arrays = _stored_arrays(path, content, names)
    if missing := [name for name in names if name not in arrays]:
        raise InputError(path, f"no {', '.join(missing)}; expected {content} with {', '.join(names)}")
    return arrays


def _stored_arrays(path: Path, content: str, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    """As `read_arrays`, without the arrays that the file lacks."""
    check_regular(path, f"{content} (.npz)")
    try:
        with zipfile.ZipFile(path) as archive:
            n_bytes = sum(e.file_size for e in archive.infolist() if e.filename.removesuffix(".npy") in names)
        if n_bytes > _MOST_BYTES:
            raise InputError(path, f"states {n_bytes} bytes of arrays; expected {content} of at most {_MOST_BYTES}")
        with np.load(path) as file:
            arrays = {name: file[name] for name in names if name in file.files}
    except InputError:
        raise
    except _UNREADABLE as error:
        raise InputError(path, f"is not a readable .npz file; expected {content}") from error
    for name, array in arrays.items():
        if array.dtype.kind not in "biufU":
            raise InputError(path, f"{name} holds {array.dtype}; expected real numbers or text")
    return arrays
